#include "controller/laws/tracking_law.hpp"

#include <algorithm>
#include <cmath>

namespace tether {
namespace {

/// Share of the acceleration for catching up. Turning and the path's own changes of speed have the
/// rest.
constexpr double kCatchUpShare = 0.9;
/// Where the path rests and the vehicle does not, the vehicle turns as if the path had this speed.
constexpr double kSlowest_mps = 1.0;
constexpr double kOnPath_m = 0.01;
constexpr double kOnPath_rad = 0.01;

}  // namespace

TrackingFeedback::TrackingFeedback(const ControllerSettings& config, double max_acceleration_mps2)
    : gains_(config.tracking),
      look_ahead_m_(gains_.k_theta / gains_.k_y),
      acceleration_mps2_(kCatchUpShare * max_acceleration_mps2),
      linear_m_(acceleration_mps2_ / (gains_.k_x * gains_.k_x)),
      max_v_mps_(config.v.limit),
      max_omega_radps_(config.omega.limit) {}

double TrackingFeedback::closing_speed(double x_e_m) const {
  const double distance_m = std::abs(x_e_m);
  if (distance_m <= linear_m_) return gains_.k_x * x_e_m;
  return std::copysign(std::sqrt(2.0 * acceleration_mps2_ * (distance_m - 0.5 * linear_m_)), x_e_m);
}

Twist TrackingFeedback::command(const Pose2& pose, const Heading& heading,
                                const PathPoint& reference) const {
  const auto [c, s] = heading;
  const double dx_m = reference.x_m - pose.x_m, dy_m = reference.y_m - pose.y_m;
  const double x_e = c * dx_m + s * dy_m;
  const double y_e = c * dy_m - s * dx_m;
  const double theta_e = reference.yaw_rad - pose.yaw_rad;
  const auto [sin_e, cos_e] = sin_cos(theta_e);

  Twist u;
  u.v_mps = std::clamp(reference.v_mps * cos_e + closing_speed(x_e), -max_v_mps_, max_v_mps_);
  const double alpha =
      direction_of(y_e + look_ahead_m_ * sin_e, look_ahead_m_ * cos_e + std::max(x_e, 0.0));
  // The path's speed, not v: when the vehicle catches up at three times the path's speed, the gain
  // would ask for more than the wheels can do.
  const double speed_mps = std::max(reference.v_mps, std::min(std::abs(u.v_mps), kSlowest_mps));
  u.omega_radps = std::clamp(reference.omega_radps + speed_mps * gains_.k_theta * alpha,
                             -max_omega_radps_, max_omega_radps_);
  // The path's own speed is never taken away: it was checked against the vehicle.
  const double lateral_mps2 = std::abs(u.v_mps * u.omega_radps);
  if (lateral_mps2 > gains_.max_lateral_mps2 && std::abs(u.v_mps) > reference.v_mps) {
    const double slower_mps = gains_.max_lateral_mps2 / std::abs(u.omega_radps);
    u.v_mps = std::copysign(std::max(slower_mps, reference.v_mps), u.v_mps);
  }
  return u;
}

bool is_on_path(const Pose2& pose, const PathPoint& reference) {
  const double dx_m = reference.x_m - pose.x_m, dy_m = reference.y_m - pose.y_m;
  return dx_m * dx_m + dy_m * dy_m < kOnPath_m * kOnPath_m &&
         std::abs(wrap_angle(reference.yaw_rad - pose.yaw_rad)) < kOnPath_rad;
}

LawErrors errors_to(const Pose2& pose, const PathPoint& reference) {
  const double dx_m = reference.x_m - pose.x_m, dy_m = reference.y_m - pose.y_m;
  const double distance_m = std::hypot(dx_m, dy_m);
  const double heading_rad =
      distance_m > 0.0 ? wrap_angle(std::atan2(dy_m, dx_m) - pose.yaw_rad) : 0.0;
  return {heading_rad, distance_m};
}

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
