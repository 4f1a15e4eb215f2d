#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// How much of the drivetrain's start-up is done, and whether it may move.
enum class DrivePhase {
  starting,  ///< configuration in progress; power stages off
  refused,   ///< cannot be used: `reason` says what a technician has to look at
  standby,   ///< configured, watched over by its own watchdog, power stages off
  enabling,  ///< configuration being verified, power stages being switched on; setpoint zero
  enabled,   ///< follows setpoints
  stopping,  ///< a quick stop or disable is under way
  faulted,   ///< a drive reported a fault, went missing or rebooted: latched until reset_fault()
};
const char* to_string(DrivePhase phase);

enum class StopKind {
  quick,    ///< brake as hard as configured (CiA 402 quick stop), then power stages off
  disable,  ///< power stages off now; only when standing still
};

/// Feedback of one wheel. SI units at the wheel's rim, forward positive, whatever the drive's
/// own units and mounting are.
struct WheelFeedback {
  bool valid = false;  ///< something was received since the last start
  Instant stamp{};     ///< time of the newest position or speed
  /// Since the bridge's start; counted through the drive's wrap-around. After a silence it takes up
  /// what the drive counted meanwhile, unless the drive may have rebooted: then it goes on from
  /// where it was.
  double angle_rad = 0;
  /// How far the wheel may have turned in all without being counted in angle_rad: over reboots of
  /// its drive and jumps of its counter. Never falls.
  double uncounted_rad = 0;
  double speed_radps = 0;
  /// The faster of reported speed and counted positions, as far as they are fresh; else
  /// speed_radps.
  double fastest_radps = 0;
  std::int64_t position_counts = 0;  ///< like angle_rad, in the drive's counts, unwrapped, signed
  std::string state;                 ///< "OperationEnabled", "Fault" … as the profile names it
  std::uint32_t statusword = 0;
  std::uint32_t error_code = 0;  ///< error code of the drive; 0 none
};

struct DrivetrainSnapshot {
  DrivePhase phase = DrivePhase::starting;
  /// Why `refused` or `faulted`, or what start-up is waiting for: one line for a technician, such
  /// as "right drive (node 2): no heartbeat for 300 ms: check its supply and the CAN plug".
  std::string reason;
  std::array<WheelFeedback, 2> wheels;  ///< left, right
  /// Both wheels stand, by both witnesses (WheelMotion).
  bool standstill = false;
  bool turning = false;         ///< a fresh witness says that a wheel turns
  bool feedback_fresh = false;  ///< both wheels' feedback is younger than its deadline
  /// A drive that was heard, or commanded, may have power on or turn, as far as is known: however
  /// old that knowledge is.
  bool in_doubt = false;
};

/// The protocol of one make of drivetrain, without I/O and without a clock: frames and time in,
/// frames out. A new make is a new class (docs/howto/drivetrain.md says how).
///
/// Contract
/// - Frames leave only through tick(), which the caller invokes once per control cycle, after it
///   has checked the command's freshness. A caller that hangs therefore falls silent at once, and
///   the drives' own watchdogs stop the vehicle.
/// - Power stages go on only by enable(), from standby; a non-zero setpoint leaves only in
///   `enabled`.
/// - `faulted` is latched: only reset_fault() leaves it, to `starting` or `standby`, never to
///   `enabled`.
class DriveProfile {
 public:
  struct Counters {
    std::int64_t rejected_frames = 0;     ///< ours by identifier, but of wrong length or content
    std::int64_t intruder_frames = 0;     ///< commands on this bus that are not ours
    std::int64_t intruder_writes = 0;     ///< … that changed what the bridge had configured
    std::int64_t stops_by_sdo = 0;        ///< for drives that do not take them by PDO
    std::int64_t heartbeat_withheld = 0;  ///< times, so that a drive's watchdog stops it
    std::int64_t brake_escalations = 0;   ///< steps taken because a wheel did not brake
    std::int64_t warnings = 0;            ///< messages of the drives that stop nothing
    /// Feedback in excess of the drives' own: another sender's.
    std::int64_t surplus_feedback = 0;
  };

  virtual ~DriveProfile() = default;

  /// The identifiers that on_frame() wants to see.
  virtual std::vector<CanFilter> filters() const = 0;

  /// (Re)starts the drivetrain from the beginning, power stages off.
  virtual void start(Instant now) = 0;

  virtual void on_frame(const CanFrame& frame, Instant now) = 0;

  /// Once per control cycle; appends the frames to send now, most urgent first.
  virtual void tick(Instant now, std::vector<CanFrame>& out) = 0;

  /// The body twist to follow from the next tick on; ignored unless `enabled`.
  virtual void set_command(const Twist& twist) = 0;

  /// standby → enabling → enabled. Ignored in any other phase.
  virtual void enable() = 0;
  virtual void stop(StopKind kind) = 0;
  /// Until then, standstill that feedback shows switches no power stage off, because feedback is
  /// known to be wrong.
  virtual void distrust_standstill(Instant until) = 0;
  /// The deceleration of a wheel's rim that stops are to have; a wheel that reaches less than half
  /// of it gets stronger measures, if the profile has any. 0: not supervised.
  virtual void require_deceleration(double /*mps2*/) {}
  /// The speed of a wheel's rim above which a report is not possible on this vehicle.
  virtual void limit_reports(double /*rim_mps*/) {}
  /// Leaves `faulted` or `refused`: clears the drives' faults, and starts up again where a drive
  /// rebooted or was missing.
  virtual void reset_fault() = 0;

  virtual DrivetrainSnapshot snapshot(Instant now) const = 0;
  virtual Counters counters() const = 0;

  /// For the bridge's own reports: intruders seen so far as text ("0x201 from another sender"), ""
  /// if there was none.
  virtual std::string intruder() const = 0;
  /// The same for what the drives warned of since the last reset_fault(), each warning once:
  /// "left drive (node 1): 0x8110 (CAN overrun: messages lost)".
  virtual std::string warnings() const { return ""; }

 protected:
  DriveProfile() = default;
  DriveProfile(const DriveProfile&) = delete;
  DriveProfile& operator=(const DriveProfile&) = delete;
};

}  // namespace tether
