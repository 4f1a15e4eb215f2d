#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "can_bridge/cia402/braking.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/drives.hpp"
#include "can_bridge/cia402/fault_latch.hpp"
#include "can_bridge/cia402/identifiers.hpp"
#include "can_bridge/cia402/stop_assurance.hpp"
#include "can_bridge/cia402/stop_objects.hpp"
#include "can_bridge/drivetrain/drive_profile.hpp"

namespace tether::cia402 {

/// The stages from start() to `standby`, or to `refused` with the reason why.
class BringUp {
 public:
  explicit BringUp(Drives& drives) : d_(drives) {}

  /// Starts from the beginning. Drives that are heard or answer are braked first.
  void begin();
  /// In the stages from `listening` to `settling`. NMT commands go to `nmt`, SDO requests to
  /// `service`.
  void tick(Instant now, std::vector<CanFrame>& nmt, std::vector<CanFrame>& service);
  /// Before the reset: another sender may have switched this drive on. It is stopped, and what was
  /// known of its wheel does not count.
  void secure_again(std::uint8_t node);
  /// Next event that the present stage waits for.
  std::string waiting_for(Instant now) const;

 private:
  void note_lost_nodes(Instant now);
  void listen(Instant now);
  /// A drive that may be in NMT "stopped" goes to pre-operational, so that it can be asked.
  void recall(Node& node, Instant now, std::vector<CanFrame>& nmt);
  /// Its silence is not that of NMT "stopped".
  bool has_been_recalled(const Node& node, Instant now) const;
  void secure(Instant now, std::vector<CanFrame>& nmt, std::vector<CanFrame>& service);
  /// The last look at the counters before the reset clears them.
  void take_up_positions(Instant now);
  bool may_be_reset(const Node& node, Instant now) const;
  /// By its watchdog or ramp, since it was last heard.
  bool can_have_stopped(const Node& node) const;
  std::string turning_text(Instant now) const;
  void begin_configuration(Instant now);
  void configure(Instant now, std::vector<CanFrame>& nmt, std::vector<CanFrame>& service);
  void start_up(Node& node, Instant now, std::vector<CanFrame>& nmt,
                std::vector<CanFrame>& service);
  void start_nodes(Instant now, std::vector<CanFrame>& nmt);
  void activate(Instant now, std::vector<CanFrame>& nmt);
  void settle(Instant now);
  std::string not_settled(Instant now) const;

  Drives& d_;
  bool begun_ = false;  // and not yet ticked
  std::optional<Instant> ticked_;
  Instant nmt_start_at_{};
};

/// The stage `clearing`: resets the drives' faults with a rising edge of controlword bit 7.
class Clearing {
 public:
  explicit Clearing(Drives& drives) : d_(drives) {}

  void begin();
  /// Enters `settling` when no axis is in Fault any more. A fault that stays is reported again.
  std::optional<Fault> tick(Instant now);
  /// The controlword for an axis in Fault.
  std::uint16_t controlword() const;

 private:
  Drives& d_;
  bool edge_ = false;  // controlword bit 7 is set
};

/// The stages `verifying` and `enabling`.
///
/// First every object that start-up wrote or checked and that read as it should then (watchdogs and
/// their reactions, heartbeat producer, [[setup]], PDOs) is read again. Another value, an abort or
/// no answer is a fault, and reset_fault() configures the drives again. One object of each node is
/// read in a control cycle, all nodes at once: 26 objects, and so 0.52 s at 20 ms, with
/// drivetrains/two_node_cia402.toml. An answer that stays away ends it after (sdo_retries + 1) ·
/// sdo_timeout_ms.
///
/// Then up to OperationEnabled, each step within step_timeout_ms. Falling back from there before
/// the other axis has arrived is a fault, too, and so is a drive that does not show profile
/// velocity within feedback_timeout_ms from there.
class Enabling {
 public:
  explicit Enabling(Drives& drives) : d_(drives) {}

  void begin();
  /// Enters `enabled` when both axes have arrived. SDO requests go to `service`.
  std::optional<Fault> tick(Instant now, std::vector<CanFrame>& service);

 private:
  std::optional<Fault> verify(Instant now, std::vector<CanFrame>& service);
  std::optional<Fault> climb(Instant now);

  Drives& d_;
  std::array<int, 2> climbed_{};  // highest state reached
  std::array<Instant, 2> climbed_at_{};
};

/// The stage `stopping`: quick stop until both wheels stand, then power stages off.
class Stopping {
 public:
  explicit Stopping(Drives& drives) : d_(drives) {}

  /// `disable` brakes, too, if the wheels are not known to stand.
  void begin(StopKind kind);
  /// Enters `standby` when both power stages are off. A quick stop that takes longer than 5 s stays
  /// commanded and says so in the reason; a power stage that stays on is a fault.
  std::optional<Fault> tick(Instant now);
  std::uint16_t controlword(std::size_t i) const;

 private:
  void brake(Instant now);
  std::string overdue_text(Instant now) const;

  Drives& d_;
  StopKind kind_ = StopKind::quick;
  bool braking_ = false;  // before the power stages go off
};

}  // namespace tether::cia402

namespace tether {

struct VehicleConfig;

/// CANopen drives with the CiA 402 drive profile (IEC 61800-7-201) in profile velocity mode: two
/// nodes, or both axes on one node; objects, sizes, scales, signs and watchdogs as the drivetrain
/// file says.
///
/// Way to `standby`: drives that are there already are braked first; NMT reset, boot-up message,
/// SDO configuration (cia402::startup_steps), two heartbeats of the bridge (a drive watches over
/// them only from the first one on, CiA 301, 7.5.2.19), NMT start; then all drives' heartbeats must
/// say "operational", all feedback must be fresh, the power stages off and the wheels standing.
///
/// A reset switches a drive's power stage off, so that its wheel may roll on: no drive is reset
/// while a fresh witness, by PDO or SDO, says that its wheel turns. Each node, unless it has just
/// booted, is asked by SDO until its wheels stand (cia402::StandstillInquiry), also one that was
/// not heard; it gets quick stop commands meanwhile, by PDO if it is operational, by SDO if its
/// power is on. After 5 s: `refused`, the quick stop stays commanded, and reset_fault() tries
/// again. One that answers, but not with both witnesses, is reset after 5 s. A node that answers no
/// SDO cannot be asked: one that is heard may be reset only when its feedback says that it stands;
/// one that this bridge had commanded and lost, after 2 s without the bridge's heartbeat and the
/// time that its ramp takes; any other at once.
///
/// enable() first reads back what start-up has configured (cia402::Enabling).
///
/// Each tick sends, in this order: NMT command if one is due, setpoints (RPDOs), SYNC, the bridge's
/// heartbeat as due, SDO requests. Setpoints and SYNC are sent only once the drives are configured,
/// or while running ones are braked. Outside of `enabled` all target velocities are zero.
///
/// `faulted` commands stops. Each axis that still can gets a quick stop and, once its fresh
/// feedback says that it stands, "disable voltage". Causes in messages: Fault in a statusword,
/// emergency messages other than "no error" and the configuration's warnings, a boot-up message, a
/// missing heartbeat or one that does not say "operational". Causes in behaviour: feedback too old
/// while enabling or enabled, OperationEnabled left or power stage on unasked, another mode of
/// operation, another sender of what only the bridge may send, two sources of one synchronous TPDO
/// (cia402::SenderCount; then no standstill is believed until 5 s after the last, or enable()).
/// Then reset_fault() clears faults with a rising edge of controlword bit 7, or starts up again
/// where the drive's configuration may be lost. Drives that a stop does not reach by PDO:
/// cia402::StopAssurance. Wheels that do not brake: cia402::Braking.
///
/// Others may read objects by SDO at any time. A write to what start-up configures, to what a stop
/// depends on (cia402::stop_part()), or to what commands an axis is a fault from the configuration
/// on, and the stop does not rely on that object; other writes are only told of by intruder(),
/// until the next reset_fault().
///
/// Before the first frame: `starting`, wheels not valid.
class Cia402Profile final : public DriveProfile {
 public:
  /// Throws UsageError if the PDOs do not carry what the axes need (cia402::PdoMap).
  Cia402Profile(const Cia402Config& config, double wheel_radius_m, double track_m);

  std::vector<CanFilter> filters() const override;
  void start(Instant now) override;
  void on_frame(const CanFrame& frame, Instant now) override;
  void tick(Instant now, std::vector<CanFrame>& out) override;
  /// Each wheel beyond its target object's range scales both, so that the curvature stays. A twist
  /// that is not finite counts as zero.
  void set_command(const Twist& twist) override;
  void enable() override;
  /// `disable` brakes first if the wheels are not known to stand. Acts in `enabling` and `enabled`;
  /// in all other phases the power stages are off or on their way to it. A stop that takes longer
  /// than 5 s stays commanded and says so in the reason.
  void stop(StopKind kind) override;
  void distrust_standstill(Instant until) override { drives_.axes.distrust_standstill(until); }
  void require_deceleration(double mps2) override { braking_.require(mps2); }
  void limit_reports(double rim_mps) override {
    drives_.axes.limit_reports(rim_mps / drives_.axes.wheel_radius_m());
  }
  void reset_fault() override;
  DrivetrainSnapshot snapshot(Instant now) const override;
  Counters counters() const override;
  std::string intruder() const override;
  std::string warnings() const override;

  /// The optional objects that the drives did not have, or refused, at the last start-up, for
  /// people.
  std::vector<std::string> notes() const { return drives_.nodes.notes(); }

 private:
  void on_intruder(const CanFrame& frame, const cia402::Sender& sender);
  void on_foreign_sdo(const CanFrame& frame, std::uint8_t node);
  void distrust_part(cia402::StopPart part, std::uint8_t node);
  bool withholds() const;
  void on_sdo(const CanFrame& frame, cia402::Node& node);
  void on_heartbeat(const CanFrame& frame, cia402::Node& node, Instant now);
  void on_boot_up(cia402::Node& node);
  void on_emergency(const CanFrame& frame, cia402::Node& node);
  void on_feedback(const CanFrame& frame, cia402::Node& node, Instant now);
  void watch_senders(std::uint32_t id, const cia402::Node& node, Instant now);

  void restart();
  void fault(const cia402::Fault& fault) { latch_.latch(fault, drives_.stage, drives_.axes); }
  void fault(const std::optional<cia402::Fault>& trouble) {
    if (trouble) fault(*trouble);
  }
  void advance(Instant now, std::vector<CanFrame>& nmt, std::vector<CanFrame>& service);
  void send_setpoints(Instant now, std::vector<CanFrame>& out);
  std::uint16_t wanted_controlword(std::size_t i, Instant now);
  bool in_doubt(Instant now) const;

  cia402::Drives drives_;
  cia402::FaultLatch latch_;
  // The stages that last.
  cia402::BringUp bring_up_{drives_};
  cia402::Enabling enabling_{drives_};
  cia402::Stopping stopping_{drives_};
  cia402::Clearing clearing_{drives_};
  cia402::StopAssurance assurance_{drives_};
  cia402::Braking braking_{drives_};
  Twist command_;
  Counters counters_;
  std::vector<std::uint32_t> intruders_;                          // their identifiers, each once
  std::vector<std::pair<std::uint8_t, std::uint16_t>> warnings_;  // node and code, each once
};

/// The profile of such drives; wheel radius and track are the vehicle's.
std::unique_ptr<DriveProfile> make_profile(const Cia402Config& config,
                                           const VehicleConfig& vehicle);

}  // namespace tether
