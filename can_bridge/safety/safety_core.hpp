#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "can_bridge/bus/can_port.hpp"
#include "can_bridge/drivetrain/config.hpp"
#include "can_bridge/drivetrain/drive_profile.hpp"
#include "can_bridge/safety/command_watch.hpp"
#include "can_bridge/safety/follow_monitor.hpp"
#include "can_bridge/safety/ramp_watch.hpp"
#include "can_bridge/safety/request_guard.hpp"
#include "can_bridge/safety/safety_inputs.hpp"
#include "can_bridge/safety/twist_limiter.hpp"
#include "can_bridge/safety/witness_monitor.hpp"
#include "common/vehicle/actuator_settings.hpp"

namespace tether {

/// The states of drivetrain_state_t, same numbers.
enum class BridgeState : std::int32_t {
  starting,
  refused,
  disarmed,
  arming,
  armed,
  stopping,
  fault,
  estop,
  unconfirmed,
};
/// "starting", "refused" …
const char* to_string(BridgeState state);

/// Outputs of the bridge in one control cycle.
struct Decision {
  enum class Action { none, enable, quick_stop, disable, reset_fault, restart_bus };

  BridgeState state = BridgeState::starting;
  std::string reason;  ///< why it is not armed, or why it stops: for a technician; "" while armed
  Action action = Action::none;
  Twist twist;  ///< setpoint in force; zero unless may_move
  /// Whether a non-zero setpoint may leave: following commands, or on the ramp down from there.
  bool may_move = false;
  bool estop_latched = false;  ///< has to survive a restart: restore_estop()
  /// While wheel feedback is known to be wrong: until then, standstill is not believed.
  std::optional<Instant> distrust_until;
};

/// Decides, once per control cycle, whether and how the vehicle may move. Pure: time, commands,
/// requests, the drives' snapshot and the bus's state in; state, reason, action and twist out.
///
/// Rules
/// - Arming takes an ARM request (each acts once, see RequestGuard) and a fresh command that is
///   zero, both when it is asked for and when the drives are on (else they are switched off again);
///   from DISARMED only, with drives in standby, wheels at standstill and a healthy bus. A refused
///   ARM is used up and leaves its reason.
/// - Commands stamped more than min(kMaxAhead, stale/2) after the bridge's own clock are rejected.
/// - Armed: a command of age `stale` (CommandWatch) or older → ramp to zero; a fresh one resumes.
///   Plans are of age 0 while they last; from the end of the horizon on they age like commands.
///   At speed v an age of max_stale_m/v is stale, if that comes earlier. Of age `disarm` or older →
///   quick stop and disarm: only ARM with a zero command goes on from there.
/// - Plans drive no farther than BlindBudget lets them: each needs a pose, and the vehicle can stop
///   within max_blind and max_blind_m from when a controller last knew where it was. From max_blind
///   on plans age. For the decelerations to act, kStopJerkDelay and four cycles are reckoned: two
///   of the limiter, two of drives and feedback.
/// - The session of plans changes only while disarmed. Until then plans of other sessions are
///   refused. A stop is obeyed from every sender: a plan of another session that says to stand
///   still disarms ("plan.stop_of_other_session"), and one of the own session needs no pose. A
///   twist that moves does not take over from a plan ("command.against_plan"), one that says to
///   stand still does.
/// - Two senders of twists or plans at the same time → FAULT: as the network tells (on_senders), or
///   behind a relay as numbers tell (CommandWatch).
/// - With operator_timeout: no ALIVE for this long → as DISARM, and no arming.
/// - Whatever ends an armed state, and RESET, ends all plans for good: those stamped before are
///   refused ("plan.before_stop"). Arming by a plan needs one that is younger than kPlanSilence and
///   not over, now and when the drives are on. Preloads are for departures: refused unless the
///   vehicle is disarmed and stands ("plan.preload_while_armed").
/// - A wheel whose reported speed contradicts its position (WitnessMonitor) → the same. A vehicle
///   that does not brake on a ramp (RampWatch) → quick stop and latched FAULT.
/// - DISARM: ramp to zero, wait for standstill (at most kStandstillWait, then quick stop), power
///   off.
/// - ESTOP: quick stop in the same cycle, latched until ESTOP_RELEASE and RESET; the release alone
///   changes nothing but the reason.
/// - A drive's fault (either wheel's), drives that refuse, wheel feedback missing while powered, a
///   wheel that does not turn as told (FollowMonitor), a bus that is bus-off, stalled, down or
///   absent, or the loop itself standing still for longer than `disarm` → quick stop and latched
///   FAULT until RESET.
/// - A bus that stalls is restarted at once, so that the setpoints which wait in its queue never
///   get out. That is done once until the next RESET, because what is sent after it moves nothing.
///   If it fails, the reason says so until RESET.
/// - RESET leads to STARTING or DISARMED, never to ARMED. It is refused while the vehicle stops or
///   fresh feedback says that its wheels turn, while the e-stop is pressed, and while the bus is
///   not up; after a wheel that did not follow also until standstill may be believed again, and
///   fresh feedback says that power is off; a bus that was off or stalled is restarted first, so
///   that no old frame is left in a queue. error-passive is reported, not latched; but no arming
///   meanwhile.
/// - Power stages are switched off only at standstill, or by drives that fault. Feedback that was
///   missing, or of a wheel that does not follow, may show standstill at full speed, and a bus in
///   trouble lets no stop through. After that, power stages stay on, braking, for as long as the
///   ramp from the last setpoint takes
///   (|v|/deceleration or |ω|/yaw deceleration, the longer) and kDistrustMargin.
/// - Safety inputs (SafetyInputs) may demand a stop: a quick stop or ramp, then disarmed; or a ramp
///   to standstill, from which the vehicle, still armed, goes on when the demand is over. While a
///   stop is demanded no arming begins, and one that is under way is given up. They may limit the
///   speed of the faster rim (the curve stays), or emergency-stop: as ESTOP, and the inputs have to
///   be clear before RESET. While an e-stop would not be remembered (no_release), ESTOP_RELEASE and
///   ARM are refused, and the reason says so in every state. no_arming refuses ARM alone.
/// - A stop after which no two witnesses of each wheel say within kStopTimeout that it stands →
///   FAULT, reported as UNCONFIRMED, until RESET and two witnesses. A latched e-stop is reported as
///   ESTOP.
/// - leave(): quick stop, standstill, power off; no arming any more. Drives of which that is not
///   known (DrivetrainSnapshot::in_doubt) count as turning.
///
/// Before the first cycle: STARTING, zero. This is software, no safety function: an emergency stop
/// has to be hard-wired. A bridge that hangs is covered only by the drives' own watchdogs.
class SafetyCore {
 public:
  struct Config {
    Duration stale = std::chrono::milliseconds{200};
    Duration disarm = std::chrono::milliseconds{500};  ///< ≥ stale > 0
    double max_stale_m = 0.5;                          ///< way on a stale command, before the ramp
    Duration max_blind = std::chrono::seconds{1};      ///< way on plans, unseen: see BlindBudget
    double max_blind_m = 1.0;
    /// Hold-to-run: ALIVE at least so often, or the vehicle ramps to zero and is disarmed; 0: off.
    Duration operator_timeout{0};
    TwistLimits limits;
    Instant earliest = kStart;  ///< stamps before this are of another run
    double wheel_radius_m = 0.4;
    ActuatorSettings actuator;  ///< treatment of commands and plans
    VehicleConfig vehicle;      ///< for its stops
    /// How the drives stop by themselves. Without a deceleration it is what is required of them:
    /// limits.max_deceleration_mps2.
    OwnStop drives_stop{};
  };

  static constexpr Duration kStandstillWait = std::chrono::seconds{2};
  /// A quick stop or power-off that takes longer latches FAULT (and goes on).
  static constexpr Duration kStopTimeout = std::chrono::seconds{5};
  /// Switching on that takes longer is given up.
  static constexpr Duration kEnableTimeout = std::chrono::seconds{5};
  /// How long a RESET waits for a restarted bus to come up.
  static constexpr Duration kBusRestartWait = std::chrono::seconds{1};
  static constexpr Duration kPlanSilence = std::chrono::seconds{1};
  static constexpr Duration kMaxAhead = std::chrono::milliseconds{50};
  static constexpr Duration kDistrustMargin = std::chrono::milliseconds{500};
  /// See leave_wait().
  static constexpr Duration kLeaveMargin = std::chrono::seconds{2};
  static constexpr Duration kLongestLeave = std::chrono::seconds{20};

  explicit SafetyCore(const Config& config);

  /// A twist command that arrives at `now`; `pose`: when that was measured from which it was made.
  void on_command(Instant now, Instant stamp, std::int64_t seq, const Twist& twist,
                  std::optional<Instant> pose = std::nullopt);
  /// A plan that arrives at `now`.
  void on_plan(Instant now, PlanSource source, Plan plan);
  /// A drive_request_t that arrives at `now`; acts in the next cycle.
  void on_request(Instant now, Instant stamp, std::int64_t seq, std::int32_t request);
  /// Several programs command the vehicle: "AGV/CMD_VEL: 10.0.0.2:40112 and …" (SoleSender); "" if
  /// not. Holds until the next call.
  void on_senders(std::string several) { several_senders_ = std::move(several); }
  /// Sets the demands of the vehicle's safety inputs, from the next cycle on. Before the first:
  /// nothing.
  void on_safety_inputs(SafetyDemands demands) { demands_ = std::move(demands); }
  /// The bus's state has changed. Remembers trouble that is over before the next cycle.
  void on_bus_state(CanState bus);
  /// The e-stop is pressed from the start, and `why`: it was latched when the bridge ended last, or
  /// this is not known. Before the first cycle.
  void restore_estop(std::string why);
  /// The answer to Action::restart_bus.
  void on_bus_restarted(bool done, const std::string& why);

  /// `driven_m`: by odometry so far, never falling.
  Decision cycle(Instant now, const DrivetrainSnapshot& drives, CanState bus, double driven_m);

  /// The program is about to end: from the next cycle on, stops and switches power off.
  void leave(Instant now);
  /// After leave(): power is off and the wheels stand, or leave_wait() is over.
  bool has_left(Instant now) const;
  /// How long to wait for that before the bridge falls silent and the drives' watchdogs act: for
  /// the ramp from the largest speed or yaw rate and kLeaveMargin, at most kLongestLeave.
  Duration leave_wait() const;
  /// After leave(): what is not in order, such as "the wheels turn at 1.20 m/s …"; "" if nothing.
  std::string left_behind() const;

  std::optional<Duration> command_age(Instant now) const { return commands_.age(now); }
  /// The plan that poses shall name.
  PlanName plan() const { return commands_.plan(); }
  std::int64_t disarms() const { return disarms_; }
  /// Appends command.…, plan.…, request.… and "disarms".
  void list(CounterList& out) const;

 private:
  enum class Motion { idle, enabling, following, ramping, stopping };
  enum class Cause { bridge, drives };

  void watch_own_loop(Instant now);
  void watch_senders(Instant now);
  void watch_bus(CanState bus);
  void purge_bus();
  void watch_drives(Instant now, const DrivetrainSnapshot& drives);
  void obey_inputs(Instant now, const DrivetrainSnapshot& drives, CanState bus);
  Twist permitted(const Twist& twist) const;
  std::string inputs_reason() const;

  void handle(DriveRequest request, Instant now, const DrivetrainSnapshot& drives, CanState bus);
  void arm(Instant now, const DrivetrainSnapshot& drives, CanState bus);
  std::string obstacle_to_arming(Instant now, const DrivetrainSnapshot& drives, CanState bus) const;
  void reset(Instant now, const DrivetrainSnapshot& drives, CanState bus);
  void finish_reset(Instant now);
  std::string why_no_plan_arms(Instant now) const;
  bool is_held(Instant now) const;
  void wait_for_restarted_bus(Instant now, CanState bus);

  void advance(Instant now, const DrivetrainSnapshot& drives);
  void begin_following(Instant now, const DrivetrainSnapshot& drives);
  void follow(Instant now, const DrivetrainSnapshot& drives);
  void follow_within_budget(const Twist& wanted, bool planned);
  void begin_ramp_down(const std::string& why, Instant now);
  void watch_age(Duration age);
  void ramp_down(Instant now, const DrivetrainSnapshot& drives);
  void watch_ramp(Instant now, const DrivetrainSnapshot& drives);
  void finish_stop(Instant now, const DrivetrainSnapshot& drives);
  void watch_standstill(Instant now, const DrivetrainSnapshot& drives);
  void begin_quick_stop(Instant now, const std::string& why);
  void count_disarm();
  void latch_fault(const std::string& reason, Cause cause = Cause::bridge);
  Duration braking_time(const Twist& from) const;

  BridgeState state(const DrivetrainSnapshot& drives) const;
  std::string reason(BridgeState state, Instant now, const DrivetrainSnapshot& drives,
                     CanState bus) const;
  std::string armed_reason(Instant now) const;
  std::string latched_reason() const;
  bool latched() const { return estop_latched_ || fault_latched_; }
  bool powered() const;

  Config config_;
  CommandWatch commands_;
  BlindBudget budget_;
  RequestGuard request_guard_;
  TwistLimiter limiter_;
  FollowMonitor monitor_;
  WitnessMonitor witnesses_;
  RampWatch ramp_watch_;
  std::vector<DriveRequest> requests_;  ///< accepted since the last cycle
  SafetyDemands demands_;
  std::string several_senders_;

  Motion motion_ = Motion::idle;
  Instant motion_since_{};
  std::optional<Instant> setpoint_zero_since_;  ///< ramping
  bool disable_sent_ = false;                   ///< stopping
  bool stop_overdue_ = false;                   ///< stopping
  bool feedback_lies_ = false;                  ///< since the last ARM
  bool did_not_follow_ = false;                 ///< a wheel, since the last ARM
  std::optional<Instant> distrust_until_;       ///< since the last stop
  std::optional<Instant> standstill_due_;       ///< deadline of a stop for confirmed standstill
  bool unconfirmed_ = false;                    ///< it was not in time
  Decision::Action action_ = Decision::Action::none;

  std::optional<Instant> held_;  ///< the newest ALIVE
  bool estop_pressed_ = false;
  bool estop_latched_ = false;
  std::string estop_restored_;  ///< why it is latched, if this bridge did not see it pressed
  bool fault_latched_ = false;
  Cause fault_cause_ = Cause::bridge;
  std::string fault_reason_;
  std::string purge_failure_;  ///< why old setpoints may still wait in the bus; until RESET
  std::string stop_reason_;    ///< reason of the last stop
  std::string notice_;         ///< why the last request was refused

  CanState worst_bus_ = CanState::up;   ///< since the last cycle
  bool is_unheard_ = false;             ///< the bus was in trouble in this cycle
  bool bus_was_jammed_ = false;         ///< old frames may wait in its queues
  bool purge_due_ = false;              ///< setpoints may wait there: to be thrown away
  bool purged_ = false;                 ///< since the last RESET
  bool restart_unfinished_ = false;     ///< the bridge took it down, and it is not up again
  std::optional<Instant> reset_since_;  ///< waiting for a restarted bus
  std::optional<Instant> last_cycle_;
  std::optional<Instant> leaving_since_;
  DrivePhase last_phase_ = DrivePhase::starting;
  bool turning_ = false;   ///< by fresh feedback of the last cycle
  bool in_doubt_ = false;  ///< DrivetrainSnapshot's, of the last cycle
  double fastest_rim_mps_ = 0.0;
  std::int64_t disarms_ = 0;
  std::int64_t late_preloads_ = 0;
  std::int64_t foreign_stops_ = 0;
  std::int64_t twists_against_plans_ = 0;
  bool foreign_stop_due_ = false;
  bool slowed_by_budget_ = false;
  bool stale_ = false;   ///< following: the command is too old to be followed
  Duration last_age_{};  ///< following
};

}  // namespace tether
