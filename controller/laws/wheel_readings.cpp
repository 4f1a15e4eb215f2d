#include "controller/laws/wheel_readings.hpp"

#include <algorithm>
#include <cmath>

namespace tether {
namespace {

/// Value and derivative at the share `u` of an interval, by both at its ends.
struct Cubic {
  double value = 0.0;
  double slope = 0.0;

  Cubic(double from, double from_slope, double to, double to_slope, double length, double u) {
    const double m0 = from_slope * length, m1 = to_slope * length;
    const double a = 2.0 * (from - to) + m0 + m1, b = 3.0 * (to - from) - 2.0 * m0 - m1;
    value = ((a * u + b) * u + m0) * u + from;
    slope = ((3.0 * a * u + 2.0 * b) * u + m0) / length;
  }
};

}  // namespace

void WheelReadings::add(Instant stamp, const DeadReckoning& reckoning, const Twist& twist) {
  heard_ = true;
  if (stamp <= readings_.back().stamp) return;  // before the start, or at it
  if (reckoning.distance_m < readings_.back().reckoning.distance_m) readings_.clear();
  readings_.push_back({stamp, reckoning, twist});
  if (readings_.size() > kMost) readings_.pop_front();
}

void WheelReadings::forget(Instant until) {
  while (readings_.size() > 1 && readings_[1].stamp <= until) readings_.pop_front();
}

std::optional<Instant> WheelReadings::newest_after(Instant from) const {
  if (!heard_ || readings_.back().stamp <= from || readings_.front().stamp > from) {
    return std::nullopt;
  }
  return readings_.back().stamp;
}

std::optional<Twist> WheelReadings::twist_before(Instant until) const {
  if (!heard_) return std::nullopt;
  const Reading& r = readings_[index_at(until)];
  return r.stamp <= until ? std::optional(r.twist) : std::nullopt;
}

std::size_t WheelReadings::index_at(Instant when) const {
  const auto later = std::upper_bound(readings_.begin(), readings_.end(), when,
                                      [](Instant t, const Reading& r) { return t < r.stamp; });
  return later == readings_.begin() ? 0 : static_cast<std::size_t>(later - readings_.begin()) - 1;
}

WheelReadings::Reading WheelReadings::at(std::size_t i, Instant when) const {
  const Reading &a = readings_[i], &b = readings_[i + 1];
  if (when <= a.stamp) return a;
  if (when >= b.stamp) return b;
  const double length_s = to_seconds(b.stamp - a.stamp);
  const double u = to_seconds(when - a.stamp) / length_s;
  const Pose2 &p = a.reckoning.pose, &q = b.reckoning.pose;
  const Cubic x(p.x_m, a.twist.v_mps * std::cos(p.yaw_rad), q.x_m,
                b.twist.v_mps * std::cos(q.yaw_rad), length_s, u);
  const Cubic y(p.y_m, a.twist.v_mps * std::sin(p.yaw_rad), q.y_m,
                b.twist.v_mps * std::sin(q.yaw_rad), length_s, u);
  const Cubic yaw(0.0, a.twist.omega_radps, wrap_angle(q.yaw_rad - p.yaw_rad), b.twist.omega_radps,
                  length_s, u);
  const double yaw_rad = p.yaw_rad + yaw.value;
  Reading out{when, {}, {}};
  out.reckoning.pose = {x.value, y.value, wrap_angle(yaw_rad)};
  out.reckoning.distance_m =
      a.reckoning.distance_m + u * (b.reckoning.distance_m - a.reckoning.distance_m);
  out.twist = {x.slope * std::cos(yaw_rad) + y.slope * std::sin(yaw_rad), yaw.slope};
  return out;
}

double WheelReadings::between_m(std::size_t i) const {
  constexpr double kAcceleration_mps2 = 3.0;
  const double length_s = to_seconds(readings_[i + 1].stamp - readings_[i].stamp);
  return kAcceleration_mps2 * length_s * length_s / 64.0;
}

Rolled WheelReadings::between(std::size_t i, Instant from, Instant end) const {
  const Reading a = at(i, from), b = at(i, end);
  const Pose2 &p = a.reckoning.pose, &q = b.reckoning.pose;
  const double c = std::cos(p.yaw_rad), s = std::sin(p.yaw_rad);
  const double dx_m = q.x_m - p.x_m, dy_m = q.y_m - p.y_m;
  return {c * dx_m + s * dy_m, c * dy_m - s * dx_m, wrap_angle(q.yaw_rad - p.yaw_rad),
          b.reckoning.distance_m - a.reckoning.distance_m, b.twist};
}

WheelReadings::LaggingRims::LaggingRims(const PoseFilter& filter)
    : model(filter.model()), slower(model), state(filter.state()), slower_state(state) {
  DriveModel drive = model.drive();
  drive.lag_s += kMore_s;
  slower = MotionModel(model.limits(), drive);
}

void WheelReadings::LaggingRims::advance(const Twist& twist, double dt_s) {
  model.advance(state, twist, dt_s);
  slower.advance(slower_state, twist, dt_s);
}

bool WheelReadings::LaggingRims::stands() const {
  const WheelSpeeds &a = state.rim, &b = slower_state.rim;
  return a.left_mps == 0.0 && a.right_mps == 0.0 && b.left_mps == 0.0 && b.right_mps == 0.0;
}

LagReading WheelReadings::LaggingRims::compare(const WheelSpeeds& read) const {
  return {{read.left_mps - state.rim.left_mps, read.right_mps - state.rim.right_mps},
          {(slower_state.rim.left_mps - state.rim.left_mps) / kMore_s,
           (slower_state.rim.right_mps - state.rim.right_mps) / kMore_s}};
}

}  // namespace tether
