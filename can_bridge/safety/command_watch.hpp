#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>

#include "common/base/time.hpp"
#include "common/node/stream_guard.hpp"
#include "common/vehicle/actuator.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// Bounds time and distance that a vehicle may drive on plans without a fresh pose. A plan drives
/// on by itself, so without a bound a dead network or a dead controller is noticed only at its
/// horizon.
///
/// Both counts begin when a controller last knew where the vehicle was (CommandWatch::seen): time
/// by the clock, distance by odometry. What is left of them bounds the speed, so that the vehicle
/// can always stop within the budget:
/// - v ≤ a·(t − r) and ω ≤ α·(t − r), with the time t that is left,
/// - v ≤ a·(√(r² + 2·d/a) − r), with the distance d that is left: r·v + v²/(2a) = d,
/// a and α being the decelerations, r = reaction the time until they act. Twists are scaled as a
/// whole, so that the curve stays the curve. Distance does not bound turning on the spot.
///
/// A stop by the drives (quick stop, fault, watchdog) brakes each wheel by itself, at A. With the
/// rims' speed of turning h = |ω|·track/2 it takes (v + h)/A and the distance
/// - (v² + h²)/(2A) if h ≤ v,
/// - v·h/A if h > v: while the wheels turn against each other, v does not fall.
/// These bound the twist, too; the distance with R = drives_reaction in place of r: the bridge may
/// have to brake first, and then the drives notice only at their deadline that its setpoints end.
/// max_time may be exceeded in such a stop, by at most that deadline.
class BlindBudget {
 public:
  struct Config {
    Duration max_time = std::chrono::seconds{1};  ///< > 0
    double max_distance_m = 1.0;                  ///< > 0
    double deceleration_mps2 = 1.5;
    double yaw_deceleration_radps2 = 3.0;
    Duration reaction{};
    Duration drives_reaction{};            ///< R
    double wheel_deceleration_mps2 = 1.5;  ///< A, of a rim
    double half_track_m = 0.6;
  };
  explicit BlindBudget(const Config& config) : config_(config) {}

  /// Once per cycle, in order: `driven_m` by odometry so far, never falling, and when the vehicle
  /// was last seen; none: it was never seen, and the budget is used up.
  void update(Instant now, double driven_m, std::optional<Instant> seen);

  /// Since it was last seen, at the last update(); Duration::max() if it never was.
  Duration blind() const { return blind_; }
  /// By odometry, over that time.
  double blind_m() const { return blind_m_; }

  /// The largest share of `twist` that can still be stopped in time, 0 to 1.
  double share(const Twist& twist) const;
  /// The largest |v| at the yaw rate in force that the distance allows, m/s. A yaw rate may fall
  /// more slowly than share() asks for.
  double speed_beside(double omega_radps) const;

 private:
  double left_m() const;

  struct Sample {
    Instant when;
    double driven_m;
  };

  Config config_;
  std::deque<Sample> driven_;  ///< the last max_time, and one before
  Duration blind_ = Duration::max();
  double blind_m_ = 0.0;
};

/// Decides which twist commands and plans count, what they say now and how old that is. The
/// Actuator, with the scenario's policy, works out what they say now, also when nothing comes any
/// more. Its result goes through what SafetyCore does about old commands.
///
/// Commands are rejected and counted if their numbers are not finite or absurd (is_usable), or if
/// StreamGuard rejects them (duplicated, late, from the future or of another run). They then have
/// no effect at all, above all none on the age.
///
/// Age is now − min(stamp, arrival). So time spent in the network counts, because a command that
/// was decided half a second ago says nothing about the present. Stamp and arrival are two hosts'
/// clocks. A sender's clock that is behind by d makes every command look d older: the vehicle stops
/// early or refuses to arm. One that is ahead hides up to d of the network's delay, but never of
/// the time since the arrival; beyond the guard's max_ahead (SafetyCore: 50 ms or less) it is
/// rejected.
///
/// A plan says what to do at each time, so where one is in force the age is the time since its
/// horizon ended, and zero until then, whenever it was decided. A first plan that waits for its
/// start is as fresh, and says zero. But no plan may drive on for longer than max_blind after the
/// vehicle was last seen (PlanBuffer::seen): from then on any plan ages. So does a twist that was
/// decided from a pose as old as that ("command.blind"); one without a pose is its sender's affair.
///
/// Five restarts of the twists' numbering within kSendersWindow are two senders that take turns;
/// one that restarts now and then is one.
class CommandWatch {
 public:
  static constexpr Duration kSendersWindow = std::chrono::seconds{5};

  explicit CommandWatch(const StreamGuard::Config& config, const ActuatorSettings& actuator = {},
                        const VehicleConfig& vehicle = {},
                        Duration max_blind = std::chrono::seconds{1});

  /// Whether the command arriving at `now`, decided from a pose measured at `pose`, is accepted.
  bool offer(Instant now, Instant stamp, std::int64_t seq, const Twist& twist,
             std::optional<Instant> pose = std::nullopt);

  /// Whether the plan arriving at `now` is accepted.
  bool offer(Instant now, PlanSource source, Plan plan);

  /// The vehicle stops, for a reason that plans do not know: those that were decided before are
  /// over for good. Twists need nothing of the kind; they are old soon enough.
  void end_plans(Instant now);

  /// While the vehicle may move: plans of other sessions are refused.
  void hold_session(bool on) { actuator_.hold_session(on); }
  /// While it drives: a plan that says to stand still needs no pose.
  void accept_any_stop(bool on) { actuator_.accept_any_stop(on); }
  std::optional<std::int64_t> session() const { return actuator_.session(); }

  /// Twists that were refused as decided from too old a pose.
  std::int64_t blind() const { return blind_; }

  /// Whether two senders of twists took turns; until forget_senders().
  bool two_senders() const { return two_senders_; }
  void forget_senders();

  bool takes_plans() const { return actuator_.takes_plans(); }
  /// Whether a plan says what to do; else a twist, or nothing does.
  bool follows_plan(Instant now) const { return actuator_.plan_age(now).has_value(); }
  /// When the sender of the newest plan last saw the vehicle; none: never.
  std::optional<Instant> seen() const { return actuator_.seen(); }

  /// The age of the newest accepted command, or of the plan in force; none before the first.
  std::optional<Duration> age(Instant now) const;
  /// Where a plan counts: now − min(stamp, arrival) of the newest that was accepted from the
  /// network, which shows whether a controller still plans; Duration::max() if only preloads came,
  /// which do not show it.
  std::optional<Duration> plan_silence(Instant now) const;
  /// The twist in force; zero before the first.
  Twist twist(Instant now) const { return actuator_.in_force(now); }
  /// Whether there is a command, and it says to stand still: below 1 mm/s and 1 mrad/s.
  bool is_zero(Instant now) const;

  /// "the newest command is 230 ms old", "was" instead of "is"; with a plan "the horizon of the
  /// plan in force is 230 ms past", or "the vehicle is unseen for 1230 ms …". Only where there is
  /// an age; whole milliseconds.
  std::string age_text(Instant now, const char* verb) const;
  /// For poses: Actuator::plan().
  PlanName plan() const { return actuator_.plan(); }

  /// Appends "command.accepted", "command.non_finite" … and Actuator's.
  void list(CounterList& out) const;

 private:
  StreamGuard guard_;
  /// How much longer than allowed the vehicle is unseen, where a plan counts; 0 if it is not.
  Duration overdue(Instant now) const;
  void note_restart(Instant now);

  std::optional<Instant> as_of_;
  std::optional<Instant> plan_as_of_;
  Actuator actuator_;
  Duration max_blind_;
  std::int64_t non_finite_ = 0;
  std::int64_t blind_ = 0;
  std::deque<Instant> restarts_;  ///< restarts within the last kSendersWindow
  bool two_senders_ = false;
};

}  // namespace tether
