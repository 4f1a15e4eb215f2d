#include "controller/laws/axle_path.hpp"

#include <cmath>
#include <utility>

#include "common/vehicle/pose.hpp"

namespace tether {
namespace {

constexpr double kStep_s = 0.01;
constexpr double kEarliest_s = -20.0;
constexpr double kLatest_s = 86400.0;

}  // namespace

AxlePath::AxlePath(std::shared_ptr<const ReferencePath> path, double ahead_m)
    : path_(std::move(path)), ahead_m_(ahead_m) {
  headings_rad_.push_back(path_->at(kEarliest_s).yaw_rad);
}

PathPoint AxlePath::at(double t_s) const {
  const PathPoint p = path_->at(t_s);
  PathPoint axle = p;
  axle.yaw_rad = wrap_angle(heading_at(t_s, p.yaw_rad));
  axle.x_m -= ahead_m_ * std::cos(axle.yaw_rad);
  axle.y_m -= ahead_m_ * std::sin(axle.yaw_rad);
  axle.v_mps = p.v_mps * std::cos(p.yaw_rad - axle.yaw_rad);
  axle.omega_radps = turn_rate(p, axle.yaw_rad);
  return axle;
}

double AxlePath::turn_rate(const PathPoint& p, double heading_rad) const {
  return p.v_mps * std::sin(p.yaw_rad - heading_rad) / ahead_m_;
}

double AxlePath::heading_at(double t_s, double path_yaw_rad) const {
  if (t_s < kEarliest_s || t_s > kLatest_s) return path_yaw_rad;
  const double steps = (t_s - kEarliest_s) / kStep_s;
  const auto index = static_cast<std::size_t>(steps);
  const std::scoped_lock lock(mutex_);
  extend(index + 2);
  const double share = steps - static_cast<double>(index);
  return headings_rad_[index] + share * (headings_rad_[index + 1] - headings_rad_[index]);
}

/// Until there are `count` headings.
void AxlePath::extend(std::size_t count) const {
  while (headings_rad_.size() < count) {
    const double from_s = kEarliest_s + static_cast<double>(headings_rad_.size() - 1) * kStep_s;
    const double heading = headings_rad_.back();
    const PathPoint middle = path_->at(from_s + 0.5 * kStep_s);
    const double k1 = turn_rate(path_->at(from_s), heading);
    const double k2 = turn_rate(middle, heading + 0.5 * kStep_s * k1);
    const double k3 = turn_rate(middle, heading + 0.5 * kStep_s * k2);
    const double k4 = turn_rate(path_->at(from_s + kStep_s), heading + kStep_s * k3);
    headings_rad_.push_back(heading + kStep_s / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4));
  }
}

}  // namespace tether
