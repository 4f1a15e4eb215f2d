#include "controller/laws/predictive_law.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <tuple>
#include <utility>

#include "common/path/reference_path.hpp"
#include "common/scenario/key_table.hpp"
#include "common/vehicle/motion_model.hpp"
#include "controller/laws/law.hpp"
#include "controller/laws/pose_filter.hpp"
#include "controller/laws/tracking_law.hpp"

namespace tether {
namespace {

/// A vehicle that is moved along its path on a model, step by step, by the feedback. What it is
/// made of must outlive it.
class RollOut {
 public:
  /// From `state`. `path`: where it is then and after each step, one point more than steps.
  RollOut(const MotionModel& model, const TrackingFeedback& feedback,
          std::span<const PathPoint> path, const MotionModel::State& state, double step_s)
      : model_(model),
        feedback_(feedback),
        path_(path),
        state_(state),
        heading_(Heading::of(state.pose.yaw_rad)),
        step_s_(step_s) {}

  /// Moves on by a step with what the wheels can do of `wish`, or without one of the feedback's: of
  /// the errors at the step's beginning, with the path's own twist at its middle. Returns the
  /// command that makes the model's vehicle do so.
  Twist step(const Twist* wish = nullptr);

  std::size_t steps() const { return steps_; }  ///< so far
  const MotionModel::State& state() const { return state_; }
  const PathPoint& reference() const { return path_[steps_]; }

 private:
  Twist feedback_wish() const;

  const MotionModel& model_;
  const TrackingFeedback& feedback_;
  std::span<const PathPoint> path_;
  MotionModel::State state_;
  Heading heading_;
  double step_s_;
  std::size_t steps_ = 0;
};

Twist RollOut::step(const Twist* wish) {
  const Twist wanted = wish != nullptr ? *wish : feedback_wish();
  const Twist command = model_.pursue(state_, heading_, wanted, step_s_);
  ++steps_;
  return command;
}

Twist RollOut::feedback_wish() const {
  const PathPoint& next = path_[steps_ + 1];
  PathPoint middle = reference();
  middle.v_mps = 0.5 * (middle.v_mps + next.v_mps);
  middle.omega_radps = 0.5 * (middle.omega_radps + next.omega_radps);
  return feedback_.command(state_.pose, heading_, middle);
}

/// The drive as a law should take it: of what the filter found, what is significant.
///
/// An estimate with nothing to find is noise, and a law that acts on it is worse than one that does
/// not. So of the difference d from what was given, with standard deviation σ, a law uses
///   d · max(0, 1 − (2σ/d)⁴):
/// nothing below 2 σ, 80 % at 3 σ, 97 % at 5 σ. (A threshold as in wavelet shrinkage; the power is
/// ours.) Of a lag that is
/// adapted it uses what is almost sure, the estimate less σ: a lead that is too small costs little,
/// one for a lag that is not there makes wheels slip.
inline DriveModel significant_drive(const PoseFilter& filter, const DriveModel& given) {
  const DriveModel& found = filter.model().drive();
  const auto use = [&](double value, double from, std::size_t state) {
    const double d = value - from;
    const double limit = 2.0 * filter.standard_deviation(state);
    if (d * d <= limit * limit) return from;
    const double share = limit * limit / (d * d);
    return from + d * (1.0 - share * share);
  };
  DriveModel drive;
  drive.rim_scale = use(found.rim_scale, given.rim_scale, 7);
  drive.turn_scale = use(found.turn_scale, given.turn_scale, 8);
  const bool adapts = filter.adaptation().lag;
  drive.lag_s = adapts ? std::max(0.0, found.lag_s - filter.standard_deviation(9)) : given.lag_s;
  drive.v_bias_mps = use(found.v_bias_mps, given.v_bias_mps, 10);
  drive.omega_bias_radps = use(found.omega_bias_radps, given.omega_bias_radps, 11);
  return drive;
}

}  // namespace

void ClockEstimate::add_up(Duration up) { up_ = std::min(up_, up); }

void ClockEstimate::add_down(Duration earliest, Duration latest) {
  down_most_ = std::min(down_most_, latest);
  down_least_ = std::max(down_least_, earliest);
}

Duration ClockEstimate::offset() const {
  if (up_ == Duration::max() || down_most_ == Duration::max()) return Duration{0};
  // If delays vary, the shortest may be below what another one was at least.
  const Duration least = std::min(down_least_, down_most_);
  const double half_s = 0.25 * to_seconds(down_most_ - least);
  const double middle_s = 0.5 * to_seconds(down_most_) - half_s - 0.5 * to_seconds(up_);
  if (half_s > kWidest_s) return Duration{0};
  const double share = kPrior_s * kPrior_s / (kPrior_s * kPrior_s + half_s * half_s / 3.0);
  const Duration low = std::max(-up_, -kMost);
  const Duration high = std::max(std::min(down_most_, kMost), low);
  return std::clamp(from_seconds(share * middle_s), low, high);
}

Duration ClockEstimate::near(Duration used) const {
  const Duration estimate = offset();
  return std::chrono::abs(estimate - used) > kSame ? estimate : used;
}

namespace {

constexpr std::size_t kMostSent = 4000;  // plans remembered
/// The vehicle may still follow a plan, stopping, that ended up to this long before a pose.
constexpr Duration kRunOut = std::chrono::seconds{10};
/// A plan that is on the path for this long has settled.
constexpr Duration kSettling = std::chrono::seconds{2};

/// A vehicle as MotionModel has it, to be moved as a PoseFilter is.
struct ModelVehicle {
  const MotionModel& model;
  MotionModel::State& state;

  void advance(const Twist& twist, double dt_s) { model.advance(state, twist, dt_s); }
  bool stands() const { return state.rim.left_mps == 0.0 && state.rim.right_mps == 0.0; }
};

}  // namespace

PredictiveLaw::PredictiveLaw(const LawContext& context, Form form,
                             std::optional<MpcPlanner> planner)
    : PredictiveLaw(context.settings.get<ControllerSettings>(),
                    context.settings.get<ActuatorSettings>(),
                    context.settings.get<VehicleSettings>(), context, form) {
  planner_ = std::move(planner);
}

PredictiveLaw::PredictiveLaw(const ControllerSettings& controller, const ActuatorSettings& actuator,
                             const VehicleSettings& vehicle, const LawContext& context, Form form)
    : path_(context.path),
      samples_(path_, controller.plan_step()),
      model_(model_of(context.settings)),
      feedback_(controller, model_.limits().max_wheel_acceleration_mps2),
      delay_(DelayEstimate::kFew),
      form_(form),
      wheels_(vehicle.start_pose()),
      sensor_latency_(from_seconds(controller.sensor_latency_ms * 1e-3)),
      adapts_clock_(controller.estimator == ControllerSettings::Estimator::ekf &&
                    controller.adapt_clock),
      run_out_{actuator.deceleration_mps2, actuator.yaw_deceleration_radps2,
               model_.limits().max_wheel_acceleration_mps2, model_.limits().max_wheel_speed_mps,
               model_.limits().track_m},
      start_pose_(vehicle.start_pose()),
      step_(controller.plan_step()),
      steps_(controller.plan_steps()),
      silence_(step_ * static_cast<std::int64_t>(steps_) / 2) {
  if (controller.estimator == ControllerSettings::Estimator::ekf) {
    filter_.emplace(controller.ekf, controller.adapt, model_.limits(), start_pose_);
    model_ = filter_->model();
    given_ = model_.drive();
  }
}

void PredictiveLaw::on_pose(const SeenPose& seen) {
  delay_.add(seen.arrival - seen.stamp - sensor_latency_);
  if (adapts_clock_) estimate_clock(seen);
  if (!any_pose_) {
    for (Sent& sent : sent_) {
      if (sent.plan.name.id == preloaded_) continue;  // it did not come through the network
      sent.takes_over = std::max(sent.takes_over, sent.sent + way_down());
      if (sent.takes_over > sent.plan.start) sent.plan.settled = Instant::max();
    }
  }
  any_pose_ = true;
  if (is_unknown(seen)) ++unknown_;
  if (filter_) estimate(seen);
  while (!sent_.empty() && sent_.front().plan.end() + kRunOut < seen.stamp) sent_.pop_front();
}

/// By how much the first of the plans that led to `id` is assumed to have taken over late.
Duration PredictiveLaw::late_start(std::int64_t id) const {
  const Sent* first = find(id);
  while (first != nullptr && find(first->follows) != nullptr) first = find(first->follows);
  return first == nullptr ? Duration{0} : first->takes_over - first->plan.start;
}

/// A plan that a pose names first came on board between the pose before and this one.
void PredictiveLaw::estimate_clock(const SeenPose& seen) {
  clock_.add_up(seen.arrival - seen.stamp - sensor_latency_);
  const Sent* sent = seen.plan_id ? find(*seen.plan_id) : nullptr;
  if (last_ && sent != nullptr && seen.plan_id != last_->plan_id && seen.plan_id != preloaded_) {
    clock_.add_down(last_->stamp - sent->sent, seen.stamp - sent->sent);
  }
  last_ = seen;
  clock_offset_ = clock_.near(clock_offset_);
}

/// Moves the filter to a pose, along the plans that the vehicle followed as the pose says.
void PredictiveLaw::estimate(const SeenPose& seen) {
  Instant at = estimated_at_.value_or(std::min(seen.stamp, kStart));
  estimated_at_ = seen.stamp;
  if (is_unknown(seen)) {
    filter_->restart(seen.pose, rim_on_path(seen.stamp));
    return;
  }
  const std::int64_t none =
      seen.stamp >= kStart ? Plan::kBasedOnNone : preloaded_.value_or(Plan::kBasedOnNone);
  const bool stood = filter_->stands();
  const std::int64_t id = seen.plan_id.value_or(none);
  const bool rolled = wheels_.use(at, seen.stamp, *filter_, along(id));
  wheels_.forget(seen.stamp);
  if (stood && !rolled && !filter_->stands()) {  // how late the first plan took over is a guess
    filter_->widen(to_seconds(late_start(id)) * 0.5 *
                   filter_->model().twist(filter_->state()).v_mps);
  }
  filter_->update(seen.pose);
  model_ = MotionModel(model_.limits(), significant_drive(*filter_, given_));
}

std::optional<Plan> PredictiveLaw::preload() {
  const Prediction start{{start_pose_, {}}, Plan::kBasedOnNone, std::nullopt};
  Plan plan = roll_out(start.state, kStart);
  preloaded_ = plan.name.id;
  return remember(kStart, std::move(plan), start);
}

LawOutput PredictiveLaw::decide(Instant now, const SeenPose* newest) {
  const Instant start = start_of_next(now);
  Prediction predicted = predict(newest, start);
  if (form_ == Form::consistent && now - (newest ? newest->stamp : kStart) > silence_) {
    extend(predicted, start);
  }
  errors_ = errors_to(predicted.state.pose, reference_at(start));
  Plan plan = roll_out(predicted.state, start);
  if (predicted.range) {
    plan.settled = start;
  } else {
    ++ordinary_;
  }
  return remember(now, std::move(plan), predicted);
}

/// Turns a prediction along the plan that the newest pose names into one that holds for all settled
/// plans since. Does nothing if there is no such plan; and if the named plan is not among them,
/// does so only every other time.
void PredictiveLaw::extend(Prediction& p, Instant start) {
  const Sent* named = find(p.follows);
  const bool still =
      named != nullptr && named->is_settled(start) && is_on_path(p.state.pose, reference_at(start));
  const auto since = std::find_if(sent_.rbegin(), sent_.rend(), [&](const Sent& sent) {
    return sent.plan.name.id <= p.follows || sent.is_settled(start);
  });
  const bool any = since != sent_.rend() && since->plan.name.id > p.follows;
  extends_ = still || (any && !extends_);
  if (!extends_) return;
  p.range = {still ? p.follows : p.follows + 1, next_id_ - 1};
  if (!any) return;
  Instant at = since->takes_over;
  p.state = since->state;
  ModelVehicle vehicle{model_, p.state};
  follow(&since->plan, at, start, vehicle);
  p.follows = since->plan.name.id;
}

LawOutput PredictiveLaw::stop(Instant now) {
  Plan plan = empty_plan(start_of_next(now));
  plan.twists.emplace_back();
  Plan& sent = remember(now, std::move(plan), {});
  sent.based_on = sent.based_on_last = Plan::kBasedOnAny;
  return sent;
}

Instant PredictiveLaw::start_of_next(Instant now) const {
  const Instant start = std::max(now + way_down(), kStart);
  return std::chrono::ceil<std::chrono::microseconds>(start);  // rounded like the message field
}

/// The vehicle at `until`, and the plan that it is assumed to follow then.
PredictiveLaw::Prediction PredictiveLaw::predict(const SeenPose* newest, Instant until) const {
  Instant at = kStart;
  Prediction p = start_of_prediction(newest, at);
  const Instant seen = newest == nullptr ? at : newest->stamp;
  ModelVehicle vehicle{model_, p.state};
  if (form_ == Form::plain) {
    const std::int64_t known = p.follows;
    for (const Sent& sent : sent_) {
      if (sent.plan.name.id <= known || sent.takes_over <= seen || sent.takes_over >= until)
        continue;
      follow_until(p.follows, at, sent.takes_over, vehicle);
      p.follows = sent.plan.name.id;
    }
  } else if (const Sent* late = late_first(p, seen, until)) {
    follow_until(p.follows, at, late->takes_over, vehicle);
    p.follows = late->plan.name.id;
  }
  follow_until(p.follows, at, until, vehicle);
  return p;
}

/// The vehicle at the newest pose or odometry, or at its start; `at`: when that is.
PredictiveLaw::Prediction PredictiveLaw::start_of_prediction(const SeenPose* newest,
                                                             Instant& at) const {
  Prediction p;
  p.follows = preloaded_.value_or(Plan::kBasedOnNone);
  p.state.pose = start_pose_;
  at = kStart;
  if (newest == nullptr) return p;
  p.state.pose = newest->pose;
  at = newest->stamp;
  if (newest->plan_id || at >= kStart) p.follows = newest->plan_id.value_or(Plan::kBasedOnNone);
  if (filter_ && at == estimated_at_) {
    PoseFilter ahead = *filter_;
    const Instant rolled = wheels_.newest_after(at).value_or(at);
    wheels_.use(at, rolled, ahead, along(p.follows));
    at = rolled;
    p.state = ahead.state();
    return p;
  }
  const bool unknown = newest->follows_other || (p.follows >= 0 && find(p.follows) == nullptr);
  if (unknown) {  // it follows something unknown, most likely along the path
    p.state.rim = rim_on_path(at);
  } else if (const Sent* sent = followed_at(p.follows, at)) {
    p.state.rim = rim_at(*sent, at);
  }
  return p;
}

/// The first plan of all, if it is to be assumed that it took over, late, between `from` and
/// `until`; else null.
const PredictiveLaw::Sent* PredictiveLaw::late_first(const Prediction& p, Instant from,
                                                     Instant until) const {
  if (p.follows != Plan::kBasedOnNone || sent_.empty() || ordinary_ % 2 == 0) return nullptr;
  const Sent& first = sent_.front();
  const bool is_late = first.plan.name.id == 0 && first.takes_over > first.plan.start;
  return is_late && first.takes_over > from && first.takes_over < until ? &first : nullptr;
}

/// The plan in force at `when`: the plan `id`, or one of those that the vehicle followed before it.
const PredictiveLaw::Sent* PredictiveLaw::followed_at(std::int64_t id, Instant when) const {
  const Sent* sent = find(id);
  while (sent != nullptr && sent->takes_over > when) sent = find(sent->follows);
  return sent;
}

/// Moves `vehicle` to `until` along the plan `id` and those before it.
template <class Vehicle>
void PredictiveLaw::follow_until(std::int64_t id, Instant& at, Instant until,
                                 Vehicle& vehicle) const {
  const Sent* last = find(id);
  if (last != nullptr && last->takes_over > at) {
    follow_until(last->follows, at, std::min(until, last->takes_over), vehicle);
  }
  follow(last == nullptr ? nullptr : &last->plan, at, until, vehicle);
}

/// Moves `vehicle` along a plan from its start on; without one, and behind its end, to a
/// standstill.
template <class Vehicle>
void PredictiveLaw::follow(const Plan* plan, Instant& at, Instant until, Vehicle& vehicle) const {
  while (at < until) {
    Instant end = std::min(until, at + step_);
    Twist twist;
    if (plan != nullptr && at < plan->end()) {
      twist = plan->at(at);
      end = std::min(until, plan->start + ((at - plan->start) / step_ + 1) * step_);
    } else if (plan != nullptr && at < plan->end() + kRunOut) {
      twist = ramp_to_stop(plan->twists.back(), at - plan->end() + (end - at) / 2, run_out_);
    } else if (vehicle.stands()) {
      end = until;  // it stands
    }
    vehicle.advance(twist, to_seconds(end - at));
    at = end;
  }
}

/// The rim speeds of a vehicle that follows a plan. At the end of each step it has reached the
/// step's twist, for plans contain no others.
WheelSpeeds PredictiveLaw::rim_at(const Sent& sent, Instant when) const {
  const Plan& plan = sent.plan;
  MotionModel::State state{{}, sent.state.rim};
  Instant at = sent.takes_over;
  const auto step = static_cast<std::size_t>((when - plan.start) / plan.step);
  if (at == plan.start && step > 0) {  // in time: as in the step before
    const std::size_t last = std::min(step, plan.twists.size()) - 1;
    state.rim = model_.rim_of(plan.twists[last]);
    at = plan.start + plan.step * static_cast<std::int64_t>(last + 1);
  }
  ModelVehicle vehicle{model_, state};
  follow(&plan, at, when, vehicle);
  return state.rim;
}

const PredictiveLaw::Sent* PredictiveLaw::find(std::int64_t id) const {
  // Ids ascend, without gaps.
  if (sent_.empty() || id < sent_.front().plan.name.id || id > sent_.back().plan.name.id)
    return nullptr;
  return &sent_[static_cast<std::size_t>(id - sent_.front().plan.name.id)];
}

Plan PredictiveLaw::empty_plan(Instant start) {
  Plan plan;
  plan.name.id = next_id_++;
  plan.start = start;
  plan.step = step_;
  return plan;
}

/// The planner's result for the roll-out on a drive without errors, which follows its commands
/// exactly; empty without a planner.
std::vector<Twist> PredictiveLaw::optimised(const MotionModel::State& state,
                                            std::span<const PathPoint> path, double start_s) {
  if (!planner_) return {};
  const MotionModel ideal(model_.limits());
  RollOut rolled(ideal, feedback_, path, state, to_seconds(step_));
  std::vector<Twist> guess;
  while (rolled.steps() < std::min(steps_, planner_->steps())) guess.push_back(rolled.step());
  return planner_->improve(model_, state, start_s, to_seconds(step_), std::move(guess));
}

/// The planner's wishes first, if there is one, then those of the feedback.
Plan PredictiveLaw::roll_out(const MotionModel::State& state, Instant start) {
  const Instant on_path_clock = start - clock_offset_;
  const std::span<const PathPoint> path = samples_.from(on_path_clock, steps_ + 1);
  const std::vector<Twist> first = optimised(state, path, to_seconds(on_path_clock));
  Plan plan = empty_plan(start);
  plan.twists.reserve(steps_);
  RollOut rolled(model_, feedback_, path, state, to_seconds(step_));
  Duration on_path{};
  while (rolled.steps() < steps_) {
    const std::size_t i = rolled.steps();
    plan.twists.push_back(rolled.step(i < first.size() ? &first[i] : nullptr));
    if (on_path >= kSettling) continue;
    on_path = is_on_path(rolled.state().pose, rolled.reference()) ? on_path + step_ : Duration{};
    if (on_path >= kSettling) plan.settled = start + step_ * static_cast<std::int64_t>(i + 1);
  }
  return plan;
}

Plan& PredictiveLaw::remember(Instant now, Plan plan, const Prediction& predicted) {
  plan.based_on = form_ == Form::plain ? Plan::kBasedOnAny : predicted.follows;
  plan.based_on_last = plan.based_on;
  if (predicted.range) std::tie(plan.based_on, plan.based_on_last) = *predicted.range;
  const Instant start = plan.start;
  sent_.push_back({std::move(plan), predicted.state, predicted.follows, now, start});
  if (sent_.size() > kMostSent) sent_.pop_front();
  return sent_.back().plan;
}

void PredictiveLaw::list_counters(CounterList& out) const {
  out.emplace_back("plan.made", next_id_);
  out.emplace_back("plan.followed_unknown", unknown_);
  if (planner_) out.emplace_back("plan.not_improved", planner_->failures());
  if (filter_) filter_->list_counters(out);
  if (adapts_clock_) out.emplace_back("ekf.clock_us", to_utime(kStart + clock_offset_));
}

namespace {

template <PredictiveLaw::Form form>
LawKind kind(const std::string& name) {
  return {
      .name = name,
      .sends_plans = true,
      .keys = {"tracking.", "model.", "horizon_s", "plan_step_ms", "preload", "sensor_latency_ms"},
      .make = [](const LawContext& context) -> std::unique_ptr<Law> {
        return std::make_unique<PredictiveLaw>(context, form);
      }};
}

}  // namespace

LawKind predictive_law() { return kind<PredictiveLaw::Form::plain>("predictive"); }

LawKind predictive_consistent_law() {
  return kind<PredictiveLaw::Form::consistent>("predictive_consistent");
}

namespace {

std::vector<ScenarioKey> mpc_keys() {
  using Mpc = MpcSettings;
  KeyTable<Mpc> t(
      "controller.mpc.",
      {[](const Scenario& s) -> const Mpc& { return s.get<ControllerSettings>().own.get<Mpc>(); },
       [](Scenario& s) -> Mpc& { return s.get<ControllerSettings>().own.get<Mpc>(); }});
  t.number("steps", &Mpc::steps, {1.0, 200.0, false}, "number of optimised steps per plan");
  t.number("heading_m2", &Mpc::heading_m2, kNotNegative,
           "weight of a heading error's square against a distance's");
  t.number("rim_s2", &Mpc::rim_s2, {1e-6, 1e3, false},
           "weight of the square of a rim's change in a step, beyond the path's own");
  t.number("terminal", &Mpc::terminal, {1.0, 1e3, false}, "weight of the last step");
  t.number("within_m", &Mpc::within_m, kNotNegative,
           "farther off the path, plans are the tracking law's");
  t.number("iterations", &Mpc::iterations, {1.0, 10.0, false}, "number of linearisations per plan");
  return t.take();
}

}  // namespace

LawKind predictive_consistent_law();

/// The consistent predictive law, with the first steps of its plans optimised.
LawKind mpc_law() {
  LawKind kind = predictive_consistent_law();
  kind.name = "mpc";
  kind.keys.emplace_back("mpc.");
  kind.own_keys = mpc_keys();
  kind.make = [](const LawContext& context) -> std::unique_ptr<Law> {
    const auto& settings = context.settings.get<ControllerSettings>().own.get<MpcSettings>();
    return std::make_unique<PredictiveLaw>(context, PredictiveLaw::Form::consistent,
                                           MpcPlanner(settings, context.path));
  };
  return kind;
}

}  // namespace tether
