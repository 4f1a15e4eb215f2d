#include "controller/laws/tracking_law.hpp"

#include <algorithm>

namespace tether {
namespace {

/// Wheel speeds at a pose are computed from the commands of this long before it.
constexpr Duration kMemory = std::chrono::seconds{4};
/// A pose that is older than this is treated as if it were this old.
constexpr Duration kLongestPrediction = std::chrono::seconds{60};
constexpr Duration kModelStep = std::chrono::milliseconds{50};

}  // namespace

MotionModel model_of(const LawSettings& settings) {
  const ModelSettings& model = settings.get<ControllerSettings>().model;
  const auto& vehicle = settings.get<VehicleSettings>();
  return MotionModel({.track_m = model.track_m.value_or(vehicle.track_m),
                      .max_wheel_acceleration_mps2 = model.max_wheel_acceleration_mps2.value_or(
                          vehicle.max_wheel_acceleration_mps2),
                      .max_wheel_speed_mps = vehicle.max_wheel_speed_mps});
}

TrackingLaw::TrackingLaw(const LawContext& context)
    : path_(context.path),
      feedback_(context.settings.get<ControllerSettings>(),
                model_of(context.settings).limits().max_wheel_acceleration_mps2) {}

LawOutput TrackingLaw::decide(Instant now, const SeenPose* newest) {
  const PathPoint reference = path_->at(to_seconds(now));
  errors_ = errors_to(newest->pose, reference);
  return feedback_.command(newest->pose, reference);
}

CompensatedTrackingLaw::CompensatedTrackingLaw(const LawContext& context)
    : path_(context.path),
      model_(model_of(context.settings)),
      feedback_(context.settings.get<ControllerSettings>(),
                model_.limits().max_wheel_acceleration_mps2),
      delay_(DelayEstimate::kFew),
      sensor_latency_(
          from_seconds(context.settings.get<ControllerSettings>().sensor_latency_ms * 1e-3)) {}

void CompensatedTrackingLaw::on_pose(const SeenPose& seen) {
  delay_.add(seen.arrival - seen.stamp - sensor_latency_);
  reception_.add(seen.seq);
  // The command in force at the start of the memory is kept.
  const Instant oldest = seen.stamp - kMemory - delay_.longest();
  while (sent_.size() > 1 && sent_[1].when <= oldest) sent_.pop_front();
}

LawOutput CompensatedTrackingLaw::decide(Instant now, const SeenPose* newest) {
  const Instant arrival = now + delay_.median();
  const MotionModel::State predicted = predict(*newest, arrival);
  const PathPoint reference = path_->at(to_seconds(arrival));
  errors_ = errors_to(predicted.pose, reference);
  const Twist twist = feedback_.command(predicted.pose, reference);
  remember(now, twist);
  return twist;
}

LawOutput CompensatedTrackingLaw::stop(Instant now) {
  remember(now, {});
  return Twist{};
}

void CompensatedTrackingLaw::remember(Instant now, const Twist& twist) {
  sent_.push_back({now, twist});
  if (sent_.front().when < now - kLongestPrediction - kMemory) sent_.pop_front();
}

MotionModel::State CompensatedTrackingLaw::predict(const SeenPose& seen, Instant until) const {
  const Duration delay = delay_.median();
  const Instant from = std::max(seen.stamp, until - kLongestPrediction);
  MotionModel::State state;
  Instant at = from - kMemory;
  const auto move = [&](Instant end, const Twist& twist) {
    while (at < end) {
      const Duration step = std::min(kModelStep, end - at);
      model_.advance(state, twist, to_seconds(step));
      at += step;
    }
  };
  Twist in_force;
  double share = 1.0;  // share of commands that arrive
  const auto go_to = [&](Instant end, auto& next) {
    for (; next != sent_.end() && next->when + delay < end; ++next) {
      move(next->when + delay, in_force);
      if (share == 1.0) in_force = next->twist;
      in_force.v_mps += share * (next->twist.v_mps - in_force.v_mps);
      in_force.omega_radps += share * (next->twist.omega_radps - in_force.omega_radps);
    }
    move(end, in_force);
  };
  auto next = sent_.begin();
  go_to(from, next);  // for the wheels' speeds only
  state.pose = seen.pose;
  if (seen.rolling) {
    in_force = *seen.rolling;
    state.rim = model_.rim_of(in_force);
    share = reception_.ratio();
  }
  go_to(until, next);
  return state;
}

LawKind tracking_law() {
  return {.name = "tracking",
          .keys = {"tracking."},
          .make = [](const LawContext& context) -> std::unique_ptr<Law> {
            return std::make_unique<TrackingLaw>(context);
          }};
}

LawKind tracking_compensated_law() {
  return {.name = "tracking_compensated",
          .keys = {"tracking.", "model.", "sensor_latency_ms"},
          .make = [](const LawContext& context) -> std::unique_ptr<Law> {
            return std::make_unique<CompensatedTrackingLaw>(context);
          }};
}

}  // namespace tether
