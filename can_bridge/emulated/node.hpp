#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/bus/object_dictionary.hpp"
#include "can_bridge/bus/sdo_server.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/emulated/axis.hpp"
#include "can_bridge/emulated/drivetrain.hpp"
#include "can_bridge/emulated/objects.hpp"
#include "can_bridge/emulated/pdos.hpp"
#include "common/base/counters.hpp"
#include "common/base/time.hpp"

namespace tether {

/// An emulated drive's watch over its master: heartbeat consumers (0x1016, CiA 301, 7.5.2.19) and
/// vendors' watchdogs in milliseconds. How the drive reacts to a miss is decided elsewhere.
class EmulatedMasterWatch {
 public:
  using Handle = ObjectDictionary::Handle;

  /// `dictionary` must outlive this.
  EmulatedMasterWatch(const ObjectDictionary& dictionary, const std::vector<Handle>& consumers,
                      std::vector<Handle> watchdogs);

  /// Power-on: waits for the first heartbeat and the first contact.
  void reset();

  /// Whether a consumer may get this value now: (node << 16) | milliseconds; either zero: off. One
  /// producer has one consumer (else 0x06040043). nullopt for "yes" and for other objects.
  std::optional<canopen::Abort> refuses(Handle h, std::int64_t value) const;
  /// A consumer that was written waits for its first heartbeat again.
  void written(Handle h);

  /// True if this is the heartbeat of a watched producer. Its boot-up message does not count as
  /// one.
  bool on_heartbeat(const CanFrame& frame, Instant now);
  /// True once for each producer that fell silent, until it beats again.
  bool heartbeat_missed(Instant now);

  /// For the vendor's watchdogs: an SDO request or RPDO came; and: the NMT state changed, so that
  /// they wait for the first contact again.
  void contact(Instant now);
  void wait_for_contact() { contact_ = false; }
  /// True once each time that contact was lost.
  bool watchdog_missed(Instant now);

 private:
  struct Consumer {
    Handle object{};
    bool active = false;
    Instant last{};
  };
  const ObjectDictionary& dictionary_;
  std::vector<Consumer> consumers_;
  std::vector<Handle> watchdogs_;
  bool contact_ = false;
  Instant last_contact_{};
};

/// One emulated CANopen drive with one or two axes (CiA 301, CiA 402).
///
/// NMT: boots for kBootTime after power-on and reset node, kCommunicationBootTime after reset
/// communication, sends its boot-up message and is pre-operational. PDOs only when operational;
/// SDO, EMCY not when stopped. Booting, it neither hears nor says anything.
///
/// Watches over its master
/// - heartbeat consumer 0x1016 (if it has one): from the first heartbeat on. Late: EMCY 0x8130, the
///   reaction of 0x6007 on each axis (0 none, 1 fault, 2 disable voltage, 3 quick stop; 1 if the
///   drive has no 0x6007), and of 0x1029:1 on the NMT state (0 pre-operational, also without the
///   object; 1 none; 2 stopped; only if it is operational). The next heartbeat ends it.
/// - vendor watchdog in milliseconds, 0 = off: when operational, from the first SDO or RPDO on, and
///   none came within this time: EMCY 0x8130 and fault.
/// - RPDO deadline 0x1400:5: EMCY 0x8250 and fault.
/// - an RPDO shorter than its mapping: ignored, with EMCY 0x8210 for the first one after a good
///   one.
/// - NMT stop or reset communication with the power stage on: the reaction of 0x6007.
/// EMCY 0x0000 when all errors are gone.
class EmulatedNode final : private RpdoReceiver {
 public:
  static constexpr Duration kBootTime = std::chrono::milliseconds{300};
  static constexpr Duration kCommunicationBootTime = std::chrono::milliseconds{20};

  struct Counters {
    std::int64_t boots = 0;
    std::int64_t emcy_sent = 0;
    std::int64_t heartbeat_timeouts = 0;
    std::int64_t watchdog_timeouts = 0;
    std::int64_t rpdo_timeouts = 0;
    std::int64_t rpdo_too_short = 0;
    std::int64_t sdo_aborts = 0;
  };

  /// Powered on at `now`. It can be neither copied nor moved: its parts point at each other.
  EmulatedNode(const Cia402Config& config, std::uint8_t node, Instant now);
  EmulatedNode(const EmulatedNode&) = delete;
  EmulatedNode& operator=(const EmulatedNode&) = delete;

  void on_frame(const CanFrame& frame, Instant now, std::vector<CanFrame>& out);
  void tick(Instant now, std::vector<CanFrame>& out);
  void set_wheels(const WheelStates& wheels);
  /// Writes the targets of this node's wheels.
  void put_wheel_targets(std::array<double, 2>& targets_radps) const;
  /// Whether an axis of this node turns this wheel (0 left, 1 right) with its power stage on.
  bool powers(std::size_t wheel) const;
  void inject(const DriveFault& fault, Instant now);

  std::uint8_t id() const { return id_; }
  canopen::NmtState nmt_state() const { return nmt_; }
  Counters counters() const;
  /// Appends "node1.boots" and so on.
  void list(CounterList& out) const;

 private:
  using Handle = ObjectDictionary::Handle;

  std::int64_t value(Handle h, std::int64_t otherwise = 0) const {
    return h == ObjectDictionary::kNone ? otherwise : objects_.dictionary.value(h);
  }
  bool operational() const { return nmt_ == canopen::NmtState::operational; }

  // NMT
  void boot(Instant now, bool whole_node);
  void finish_boot(Instant now);
  void on_nmt(const CanFrame& frame, Instant now);
  void enter(canopen::NmtState state, Instant now);
  void produce_heartbeat(Instant now);

  // Objects
  std::optional<canopen::Abort> write(Handle h, std::int64_t value);
  std::optional<canopen::Abort> refuses(Handle h, std::int64_t value) const;
  void store(Handle h, std::int64_t value);
  void receive_object(Handle h, std::int64_t value) override;
  void on_sdo(const CanFrame& frame, Instant now);
  void on_process_data(const CanFrame& frame, Instant now);

  // Watching over the master
  void on_heartbeat(const CanFrame& frame, Instant now);
  void watch_master(Instant now);
  void lose_connection(EmulatedDriveAxis& axis, std::uint16_t code);  // "abort connection", 0x6007
  void stop_powered_axes();
  void leave_operational(Instant now);
  void trip_all(std::uint16_t code);

  // Errors
  void raise(std::uint16_t code);
  void send_emcy(std::uint16_t code);
  void settle_errors();

  void flush(Instant now, std::vector<CanFrame>& out);

  std::uint8_t id_;
  DriveObjects objects_;
  SdoServer sdo_;
  EmulatedPdos pdos_;
  EmulatedMasterWatch watch_;
  std::vector<EmulatedDriveAxis> axes_;

  canopen::NmtState nmt_ = canopen::NmtState::boot_up;
  bool firmware_runs_ = false;  // false from power-on or reset node to the boot-up message
  Instant boot_end_{};
  Instant last_tick_{};
  Instant next_heartbeat_{};
  Duration heartbeat_time_{0};

  std::uint16_t connection_error_ = 0;  // heartbeat lost; ends with the next one
  bool length_error_ = false;
  bool any_error_ = false;

  bool silent_ = false;
  Instant silent_until_{};
  std::vector<CanFrame> outbox_;
  Counters counters_;
};

/// The CiA 402 drives that a drivetrain file describes: one CANopen device for each node id, with
/// one or two axes (node.hpp says what each does). Objects, sizes, scales, signs and
/// watchdogs are the file's; ramps are in units of target velocity per second.
///
/// Before the first set_wheels() the wheels stand. Where a wheel is at that call is where its
/// encoder counts from.
class EmulatedCia402 final : public EmulatedDrivetrain {
 public:
  /// Powered on at `now`; the boot-up messages come EmulatedNode::kBootTime later.
  EmulatedCia402(const Cia402Config& config, Instant now);

  /// All 11-bit data frames: SDO may give a PDO any identifier.
  std::vector<CanFilter> filters() const override { return {{.id = 0, .mask = 0}}; }
  void on_frame(const CanFrame& frame, Instant now, std::vector<CanFrame>& out) override;
  void tick(Instant now, std::vector<CanFrame>& out) override;
  void set_wheels(const WheelStates& wheels) override;
  std::array<double, 2> wheel_targets_radps() const override;
  /// A fault of an unknown node does nothing.
  void inject(const DriveFault& fault, Instant now) override;
  void list(CounterList& out) const override;

  /// In the order in which the axes name them, left first.
  const std::vector<std::unique_ptr<EmulatedNode>>& nodes() const { return nodes_; }

 private:
  std::vector<std::unique_ptr<EmulatedNode>> nodes_;
};

/// The drives, powered on at `now`.
std::unique_ptr<EmulatedDrivetrain> emulate(const Cia402Config& config, Instant now);

}  // namespace tether
