#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "common/base/time.hpp"
#include "common/path/path_samples.hpp"
#include "common/vehicle/motion_model.hpp"
#include "common/vehicle/stop_ramp.hpp"
#include "controller/laws/law.hpp"
#include "controller/laws/mpc_planner.hpp"
#include "controller/laws/network_estimate.hpp"
#include "controller/laws/pose_filter.hpp"
#include "controller/laws/tracking_law.hpp"
#include "controller/laws/wheel_readings.hpp"

namespace tether {

/// By how much the vehicle's clock is ahead of the controller's.
///
/// Nothing in poses and plans shows it by itself: stamps of poses and starts of plans are by the
/// same clock, so the vehicle is where it should be, but by its own clock: v · offset away. Only
/// delays bound it, because they are not negative. Let `up` be a pose's arrival minus its stamp,
/// and `down` the time from sending a plan to having it on board. Then
///   up = δ_up − offset,   down = δ_down + offset,   so −up ≤ offset ≤ down.
/// Where the two directions take equally long, offset = (down − up)/2, as in NTP (RFC 5905, section
/// 8); where they do not, it is wrong by half the difference. When a plan was on board is known to
/// lie between two poses. The estimate is the middle, drawn to 0 by how wide that interval is:
/// the offset is taken for normal with kPrior_s before, the measurement for uniform. An
/// interval of more than ± kWidest_s says nothing: so it mostly is with one pose a second. The
/// estimate stays within the bounds, and ± kMost.
class ClockEstimate {
 public:
  static constexpr double kPrior_s = 0.05;
  static constexpr double kWidest_s = 0.03;
  static constexpr Duration kSame = std::chrono::milliseconds{3};
  static constexpr Duration kMost = std::chrono::milliseconds{200};

  /// Arrival minus stamp of a pose, without what the sensor took.
  void add_up(Duration up);
  /// A plan that was not on board `earliest` after it was sent, but was at `latest`.
  void add_down(Duration earliest, Duration latest);

  /// 0 before there is one of each.
  Duration offset() const;
  /// `used`, unless that is off by more than kSame: plans that differ are not consistent, so a
  /// change that is too small to matter is left.
  Duration near(Duration used) const;

 private:
  Duration up_ = Duration::max();          // the shortest
  Duration down_most_ = Duration::max();   // the lowest upper bound
  Duration down_least_ = Duration::min();  // the highest lower bound
};

/// Packetised predictive control: each decision is a plan, the twists of the coming
/// controller.horizon_s, from rolling TrackingFeedback out on the model within the vehicle's limits
/// (Quevedo, Nešić: Input-to-state stability of packetized predictive control over unreliable
/// networks affected by packet-dropouts. IEEE Trans. Autom. Control 56 (2), 2011).
///
/// A plan begins when it should arrive: now plus the longest delay of the last poses. What the
/// vehicle does until then is predicted from the newest pose, or, before the first one, from the
/// start of the scenario, where the vehicle is known to stand. The two forms differ in what they
/// assume it to follow:
/// - plain: the plans sent, each from its start on, as if none were lost. The vehicle follows
///   whatever arrives (based_on: any). After a loss the prediction, and so the plan, is wrong.
/// - consistent: the plan that the newest pose names, to its end, as if nothing sent since had
///   arrived. The plan says so (based_on), and the vehicle refuses it if something had arrived. So
///   whatever the vehicle follows was predicted from what it really did. Of the plans that are made
///   from one pose, the first to arrive is followed: more commands than poses mend losses and never
///   do harm.
///
/// Suppose that a pose names a plan X, and that no other pose comes for long. Plans based on X are
/// refused as soon as one of them has arrived, and the horizon of that one ends. But whatever the
/// vehicle follows then, it gets onto the path, where the feedback contracts all predictions onto
/// one: a plan has *settled* when it was predicted within 1 cm and 10 mrad of the path for 2 s (in
/// which the default gains take errors at 2.8 m/s to 4 %: (1 + λt) e^−λt, λ = v √K_y); from then
/// on, up to its end, it predicts the vehicle where all settled ones do. When the newest pose is
/// older than half the horizon, the consistent form *extends* plans: from the state that the last
/// settled plan since X predicts, it makes one that is based on whichever plan since X is in force
/// and has settled (Plan::settled; the vehicle looks that up), on X too if X has settled and the
/// pose says that it did lead onto the path. That plan is itself settled from its start on, and so
/// are the next: as long as plans get through within half a horizon, the vehicle goes on without
/// poses, open loop; controller.pose_timeout_s bounds that. If X is left out, every other plan is
/// an ordinary one, for a vehicle that has received nothing since.
///
/// With an estimator (controller.estimator) the newest pose is not taken for the truth: PoseFilter
/// moves along the plans that the vehicle followed from pose to pose, each of which names the last
/// of them; or by what the wheels rolled, where the vehicle sends its odometry, up to the newest of
/// that. Predictions start from its estimate, on its estimate of the drive, and plans hold the
/// commands by which such a drive does what they mean.
///
/// Before the first pose the delay is not known, and plans begin when they are sent. If the delay
/// turns out to be longer, the first plan took over late, in its middle, while the vehicle was
/// still at rest. The consistent form then bases every other plan on that assumption, until a pose
/// says what is in force.
class PredictiveLaw final : public Law {
 public:
  enum class Form { plain, consistent };

  /// With a planner: the first steps of its plans are not only rolled out, but optimised.
  PredictiveLaw(const LawContext& context, Form form,
                std::optional<MpcPlanner> planner = std::nullopt);

  void on_pose(const SeenPose& seen) override;
  void on_odometry(const SeenOdometry& seen) override {
    if (filter_) wheels_.add(seen.stamp, seen.reckoning, seen.twist);
  }
  LawOutput decide(Instant now, const SeenPose* newest) override;
  /// A plan that ends at once: the vehicle stops.
  LawOutput stop(Instant now) override;
  bool plans_ahead() const override { return true; }
  std::optional<Plan> preload() override;
  /// The errors of the vehicle as predicted for the plan's start.
  LawErrors errors() const override { return errors_; }
  void list_counters(CounterList& out) const override;

 private:
  PredictiveLaw(const ControllerSettings& controller, const ActuatorSettings& actuator,
                const VehicleSettings& vehicle, const LawContext& context, Form form);
  struct Sent {
    Plan plan;
    MotionModel::State state;  ///< predicted at its start
    std::int64_t follows;  ///< id of what the vehicle was predicted to follow until then, or none
    Instant sent;
    Instant takes_over;  ///< its start; later if it must have arrived later

    bool is_settled(Instant t) const { return plan.settled <= t && t < plan.end(); }
  };
  struct Prediction {
    MotionModel::State state;
    std::int64_t follows = Plan::kBasedOnNone;
    /// The prediction holds for all settled plans from the first to the last of this range.
    std::optional<std::pair<std::int64_t, std::int64_t>> range = std::nullopt;
  };
  Instant start_of_next(Instant now) const;
  Prediction predict(const SeenPose* newest, Instant until) const;
  Prediction start_of_prediction(const SeenPose* newest, Instant& at) const;
  void extend(Prediction& p, Instant start);
  const Sent* late_first(const Prediction& p, Instant from, Instant until) const;
  const Sent* followed_at(std::int64_t id, Instant when) const;
  void estimate(const SeenPose& seen);
  void estimate_clock(const SeenPose& seen);
  Duration late_start(std::int64_t id) const;
  bool is_unknown(const SeenPose& seen) const {
    return seen.follows_other || (seen.plan_id && find(*seen.plan_id) == nullptr);
  }
  Duration way_down() const { return delay_.longest() + 2 * clock_offset_; }
  /// The path's point while the vehicle's clock says `when`.
  PathPoint reference_at(Instant when) const { return path_->at(to_seconds(when - clock_offset_)); }
  /// Moves a vehicle along the plan `id` and those before it.
  auto along(std::int64_t id) const {
    return [this, id](Instant at, Instant until, auto& vehicle) {
      follow_until(id, at, until, vehicle);
    };
  }
  template <class Vehicle>
  void follow_until(std::int64_t id, Instant& at, Instant until, Vehicle& vehicle) const;
  template <class Vehicle>
  void follow(const Plan* plan, Instant& at, Instant until, Vehicle& vehicle) const;
  WheelSpeeds rim_on_path(Instant when) const {
    const PathPoint reference = reference_at(when);
    return model_.rim_of({reference.v_mps, reference.omega_radps});
  }
  WheelSpeeds rim_at(const Sent& sent, Instant when) const;
  const Sent* find(std::int64_t id) const;
  Plan empty_plan(Instant start);
  std::vector<Twist> optimised(const MotionModel::State& state, std::span<const PathPoint> path,
                               double start_s);
  Plan roll_out(const MotionModel::State& state, Instant start);
  Plan& remember(Instant now, Plan plan, const Prediction& predicted);

  std::shared_ptr<const ReferencePath> path_;
  PathSamples samples_;
  MotionModel model_;
  TrackingFeedback feedback_;
  std::optional<MpcPlanner> planner_;
  DelayEstimate delay_;
  Form form_;
  std::optional<PoseFilter> filter_;
  DriveModel given_;  ///< before anything was estimated
  WheelReadings wheels_;
  std::optional<Instant> estimated_at_;  ///< when the filter's estimate is of
  Duration sensor_latency_;
  bool adapts_clock_;
  ClockEstimate clock_;
  Duration clock_offset_{};       ///< the vehicle's, as it is used
  std::optional<SeenPose> last_;  ///< the pose before
  StopLimits run_out_;
  Pose2 start_pose_;
  Duration step_;
  std::size_t steps_;
  Duration silence_;
  bool extends_ = false;       ///< the last plan did so: see extend()
  std::int64_t ordinary_ = 0;  ///< number of plans that did not
  std::deque<Sent> sent_;
  std::int64_t next_id_ = 0;
  std::optional<std::int64_t> preloaded_;
  bool any_pose_ = false;
  std::int64_t unknown_ = 0;
  LawErrors errors_;
};

}  // namespace tether
