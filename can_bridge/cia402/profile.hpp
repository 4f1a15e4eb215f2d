#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/cia402/axis.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/identifiers.hpp"
#include "can_bridge/cia402/node_startup.hpp"
#include "can_bridge/cia402/pdo.hpp"
#include "can_bridge/cia402/standstill.hpp"
#include "can_bridge/cia402/texts.hpp"
#include "can_bridge/drivetrain/drive_profile.hpp"

namespace tether {

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
/// while a wheel is known to turn. A node that was heard in any NMT state, unless it has just
/// booted, is asked by SDO until its wheels stand (cia402::StandstillInquiry); an operational one
/// gets quick stop commands meanwhile. After 5 s: `refused`, the quick stop stays commanded, and
/// reset_fault() tries again. A node that answers no SDO cannot be asked: an operational one may be
/// reset when its feedback says that it stands or, without feedback, after 2 s of quick stop
/// commands, any other at once.
///
/// Each tick sends, in this order: NMT command if one is due, setpoints (RPDOs), SYNC, the bridge's
/// heartbeat as due, SDO requests. Setpoints and SYNC are sent only once the drives are configured,
/// or while running ones are braked. Outside of `enabled` all target velocities are zero.
///
/// `faulted`: each axis that still can gets a quick stop and, once its fresh feedback says that it
/// stands, "disable voltage". Causes: Fault in a statusword, emergency messages other than "no
/// error", a boot-up message, a missing heartbeat or one that does not say "operational", feedback
/// too old while enabling or enabled, OperationEnabled left or power stage on unasked, another mode
/// of operation, another sender of what only the bridge may send. Then reset_fault() clears faults
/// with a rising edge of controlword bit 7, or starts up again where the drive's configuration may
/// be lost.
///
/// Others may read objects by SDO at any time. intruder() tells of whoever did more since the last
/// reset_fault().
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
  void distrust_standstill(Instant until) override { standstill_from_ = until; }
  void reset_fault() override;
  DrivetrainSnapshot snapshot(Instant now) const override;
  Counters counters() const override { return counters_; }
  std::string intruder() const override;

  /// What optional objects the drives did without at the last start-up, for people.
  std::vector<std::string> notes() const;

 private:
  enum class Stage {
    idle,         // before start()
    listening,    // for drives that are there already
    securing,     // until the wheels of those stand
    configuring,  // reset, boot-up, SDO
    beating,      // the drives get to know the bridge's heartbeat
    activating,   // NMT start, until all drives are operational and send feedback
    settling,     // until power stages are off and wheels stand
    standby,
    enabling,
    enabled,
    stopping,
    faulted,
    clearing,  // fault reset under way
    refused,
  };
  struct Node {
    Node(const Cia402Config& config, std::uint8_t number)
        : id(number),
          name(cia402::node_name(config, number)),
          startup(config, number),
          inquiry(config, number) {}

    std::uint8_t id;
    std::string name;
    cia402::NodeStartup startup;
    cia402::StandstillInquiry inquiry;
    std::optional<canopen::NmtState> state;  // of the newest heartbeat
    Instant heartbeat_stamp{};
    // Before it is reset:
    bool heard = false;    // in any NMT state, and not booted since
    bool running = false;  // operational
  };
  /// Which of two causes of one fault is told.
  enum class Cause { feedback, other };

  // cia402_profile.cpp: frames and setpoints
  Node& node_of(std::uint8_t id);
  void on_intruder(std::uint32_t id, cia402::Sender::Kind kind);
  void on_sdo(const CanFrame& frame, Node& node);
  void on_heartbeat(const CanFrame& frame, Node& node, Instant now);
  void on_boot_up(Node& node);
  void on_emergency(const CanFrame& frame, Node& node);
  void on_feedback(const CanFrame& frame, Node& node, Instant now);
  void send_setpoints(Instant now, std::vector<CanFrame>& out);
  void send_heartbeat(Instant now, std::vector<CanFrame>& out);
  std::array<std::int64_t, 2> target_velocities() const;

  // cia402_bring_up.cpp: from start() to standby
  void restart();
  void listen(Instant now);
  void secure(Instant now, std::vector<CanFrame>& service);
  bool may_be_reset(const Node& node, Instant now) const;
  std::string turning_text(Instant now) const;
  void begin_configuration();
  void configure(Instant now, std::vector<CanFrame>& service);
  void start_nodes(Instant now, std::vector<CanFrame>& nmt);
  void activate(Instant now, std::vector<CanFrame>& nmt);
  void settle(Instant now);
  std::string waiting_for(Instant now) const;

  // cia402_stages.cpp: faults, enabling, stopping, resetting
  void enter(Stage stage);
  bool supervised() const;
  void fault(const std::string& reason, bool needs_restart, Cause cause = Cause::other);
  void fault_of_axis(std::size_t i, const char* what);
  void tell_error_code();
  void refuse(const std::string& reason);
  void check_axis(std::size_t i);
  void watch(Instant now);
  void advance(Instant now, std::vector<CanFrame>& nmt, std::vector<CanFrame>& service);
  void climb(Instant now);
  void brake(Instant now);
  void clear(Instant now);
  std::uint16_t wanted_controlword(std::size_t i, Instant now);
  std::uint16_t stop_controlword(std::size_t i, Instant now);
  bool all_fresh(Instant now) const;
  std::string feedback_text(std::size_t i) const;
  std::string overdue_stop(Instant now) const;
  DrivePhase phase() const;

  Duration in_stage(Instant now) const { return now - stage_since_.value_or(now); }
  Duration step_timeout() const { return std::chrono::milliseconds(config_.step_timeout_ms); }
  Duration heartbeat_timeout() const {
    return std::chrono::milliseconds(config_.drive_heartbeat_timeout_ms);
  }

  Cia402Config config_;
  double wheel_radius_m_;
  double track_m_;
  cia402::PdoMap pdos_;
  std::array<cia402::Axis, 2> axes_;
  std::vector<Node> nodes_;

  Stage stage_ = Stage::idle;
  std::optional<Instant> stage_since_;  // the first tick in it
  std::string reason_;
  std::optional<std::size_t> fault_axis_;  // whose error code is still missing in reason_
  std::string fault_what_;                 // what else to say of it
  Cause cause_ = Cause::other;
  bool needs_restart_ = false;
  bool commanding_ = false;         // setpoints and SYNC are sent
  std::array<bool, 2> released_{};  // braked; the power stage may go off
  StopKind stop_kind_ = StopKind::quick;
  Instant standstill_from_ = Instant::min();  // before that, none is believed
  bool braking_ = false;                      // `stopping`: before the power stages go off
  bool reset_edge_ = false;                   // `clearing`: controlword bit 7 is set
  std::array<int, 2> climbed_{};              // `enabling`: highest state reached
  std::array<Instant, 2> climbed_at_{};
  Instant nmt_start_at_{};
  Twist command_;
  int beats_ = 0;  // of the bridge, since the drives were told to listen for them
  std::optional<Instant> next_beat_;
  Counters counters_;
  std::vector<std::uint32_t> intruders_;  // their identifiers, each once
};

}  // namespace tether
