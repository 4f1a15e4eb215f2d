#include "controller/tube/reach_tube.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "common/vehicle/frames.hpp"

namespace tether {
namespace {

using Eigen::Vector2d;

constexpr int kDirections = 12;  // of half a circle, and their opposites
constexpr int kFiner = 5;        // steps of integration in one of the plan

Vector2d turned(const Vector2d& v) { return {-v.y(), v.x()}; }

/// Along the arc of a twist that holds for `dt_s`.
Vector2d arc(double yaw_rad, double v_mps, double omega_radps, double dt_s) {
  const Pose2 end = along_arc({0.0, 0.0, yaw_rad}, v_mps * dt_s, omega_radps * dt_s);
  return {end.x_m, end.y_m};
}

/// A part of a range, by its centre and half its width.
struct Cell {
  double centre = 0.0, half = 0.0;
};

std::vector<Cell> cells(double low, double high, int count) {
  if (!(high > low)) return {{low, 0.0}};
  const double half = 0.5 * (high - low) / count;
  std::vector<Cell> all;
  for (int i = 0; i < count; ++i) all.push_back({low + (2 * i + 1) * half, half});
  return all;
}

/// The twist that a drive with a clock and a lag is at, in the middle of each fine step.
std::vector<Twist> followed(const TubePlan& plan, double clock_s, double lag_s) {
  const double dt_s = plan.step_s / kFiner;
  const auto last = static_cast<std::ptrdiff_t>(plan.twists.size()) - 1;
  const auto at = [&](double t_s) {
    const auto i = static_cast<std::ptrdiff_t>(std::floor(t_s / plan.step_s));
    return plan.twists[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(i, 0, last))];
  };
  const double keep = lag_s > 0.0 ? std::exp(-dt_s / lag_s) : 0.0;
  Twist is = plan.twists.front();
  // What a clock that is ahead has executed already when the silence begins.
  for (double t_s = 0.5 * dt_s; t_s < clock_s; t_s += dt_s) {
    is = {at(t_s).v_mps + keep * (is.v_mps - at(t_s).v_mps),
          at(t_s).omega_radps + keep * (is.omega_radps - at(t_s).omega_radps)};
  }
  std::vector<Twist> all;
  for (std::size_t k = 0; k < plan.twists.size() * kFiner; ++k) {
    const Twist to = at((static_cast<double>(k) + 0.5) * dt_s + clock_s);
    is = {to.v_mps + keep * (is.v_mps - to.v_mps),
          to.omega_radps + keep * (is.omega_radps - to.omega_radps)};
    all.push_back(is);
  }
  return all;
}

struct CellOfBox {
  Cell radius, track, clock, lag;
};

/// What is reached from one cell, as it is integrated.
class Reach {
 public:
  Reach(const TubePlan& plan, const TubeBounds& bounds, const CellOfBox& cell,
        const std::vector<Twist>& followed)
      : b_(bounds), cell_(cell), followed_(followed), dt_s_(plan.step_s / kFiner) {
    // With a fine step, for switching within one.
    slack_s_ = cell.clock.half + cell.lag.half + bounds.slewing_s + dt_s_;
    larger_ = 1.0 + cell.radius.centre;
    wider_ = 1.0 + cell.track.centre;
    for (int i = 0; i < kDirections; ++i) {
      const double angle = std::numbers::pi * i / kDirections;
      directions_[static_cast<std::size_t>(i)] = {std::cos(angle), std::sin(angle)};
    }
  }

  /// `variation`: of the plan's twists up to the end of this fine step and the shifts beyond it.
  void step(std::size_t k, const Twist& variation) {
    const Twist& w = followed_[k];
    const double v = larger_ * w.v_mps, omega = larger_ * wider_ * w.omega_radps;
    const Vector2d moved = arc(yaw_rad_, v, omega, dt_s_);
    const double speed_m = std::abs(v) * dt_s_;
    const double most_larger = larger_ + cell_.radius.half, most_wider = wider_ + cell_.track.half;
    const double turned_rad = std::abs(swept_rad_) + 0.5 * std::abs(w.omega_radps) * dt_s_;
    // Headings: linear parts, those of shifts, and of second order.
    const double of_radius = cell_.radius.half * wider_, of_track = cell_.track.half * larger_;
    const double shifted_rad = slack_s_ * variation.omega_radps * most_larger * most_wider;
    const double second_rad = cell_.radius.half * cell_.track.half * turned_rad;
    const double time_s = (static_cast<double>(k) + 1.0) * dt_s_;
    const double heading_rad = b_.start_rad + (of_radius + of_track) * turned_rad + shifted_rad +
                               second_rad + b_.yaw_radps * time_s;
    const double nu = cell_.radius.half * std::abs(w.v_mps) + b_.speed_mps;
    ball_m_ += speed_m * (shifted_rad + second_rad + 0.5 * heading_rad * heading_rad) +
               nu * dt_s_ * heading_rad;
    shifted_m_ = slack_s_ * variation.v_mps * most_larger * (1.0 + heading_rad);
    const double middle_rad = swept_rad_ + 0.5 * w.omega_radps * dt_s_;
    by_radius_ += cell_.radius.half / larger_ * moved + of_radius * middle_rad * turned(moved);
    by_track_ += of_track * middle_rad * turned(moved);
    for (std::size_t i = 0; i < directions_.size(); ++i) {
      along_m_[i] += b_.speed_mps * std::abs(moved_direction(moved).dot(directions_[i])) * dt_s_;
    }
    // Within a fine step the direction turns by this much.
    ball_m_ += b_.speed_mps * dt_s_ * 0.5 * std::abs(omega) * dt_s_;
    swept_rad_ += w.omega_radps * dt_s_;
    yaw_rad_ += omega * dt_s_;
    place_ += moved;
    lateral_mps2_ = std::max(lateral_mps2_, std::abs(v * omega));
    if ((k + 1) % kFiner == 0) places_.push_back(place_);
  }

  /// The farthest from `planned` that it can be now.
  double farthest_m(const Vector2d& planned) const {
    const Vector2d off = place_ - planned, by_heading = b_.start_rad * turned(place_);
    double most = 0.0;
    for (std::size_t i = 0; i < directions_.size(); ++i) {
      const Vector2d& u = directions_[i];
      double support = std::abs(off.dot(u)) + along_m_[i] + std::abs(by_heading.dot(u)) +
                       std::abs(by_radius_.dot(u)) + std::abs(by_track_.dot(u));
      if (b_.yaw_radps > 0.0) support += b_.yaw_radps * yaw_support(u);
      most = std::max(most, support);
    }
    return most / std::cos(0.5 * std::numbers::pi / kDirections) + ball_m_ + shifted_m_ +
           b_.start_m;
  }

 private:
  Vector2d moved_direction(const Vector2d& moved) const {
    const double length = moved.norm();
    return length > 0.0 ? Vector2d(moved / length)
                        : Vector2d(std::cos(yaw_rad_), std::sin(yaw_rad_));
  }

  /// Of a yaw rate of 1 rad/s, whose sign may change: what turns at s moves all that comes after.
  /// Between two places the way bulges by no more than |v ω| Δ²/8.
  double yaw_support(const Vector2d& u) const {
    const double step_s = kFiner * dt_s_;
    const double now = turned(place_).dot(u), bulge_m = 0.125 * lateral_mps2_ * step_s * step_s;
    double before = 0.0, integral = 0.0;
    for (const Vector2d& place : places_) {
      const double at = turned(place).dot(u);
      integral += (std::max(std::abs(now - at), std::abs(now - before)) + bulge_m) * step_s;
      before = at;
    }
    return integral;
  }

  const TubeBounds& b_;
  const CellOfBox& cell_;
  const std::vector<Twist>& followed_;
  double dt_s_, slack_s_, larger_, wider_;
  std::array<Vector2d, kDirections> directions_;
  std::array<double, kDirections> along_m_{};
  Vector2d place_ = Vector2d::Zero(), by_radius_ = Vector2d::Zero(), by_track_ = Vector2d::Zero();
  double yaw_rad_ = 0.0, swept_rad_ = 0.0;
  double ball_m_ = 0.0, shifted_m_ = 0.0;
  double lateral_mps2_ = 0.0;  // greatest |v ω|, m/s²
  std::vector<Vector2d> places_;
};

/// Total variation of the twists that can be in force up to the end of each of the plan's steps,
/// with a clock that is ahead by `clock_s`.
std::vector<Twist> variations(const TubePlan& plan, double clock_s) {
  std::vector<Twist> all;
  const auto ahead = static_cast<std::size_t>(std::ceil(clock_s / plan.step_s)) + 1;
  std::vector<Twist> sums{{0.0, 0.0}};
  for (std::size_t i = 1; i < plan.twists.size(); ++i) {
    sums.push_back({sums.back().v_mps + std::abs(plan.twists[i].v_mps - plan.twists[i - 1].v_mps),
                    sums.back().omega_radps +
                        std::abs(plan.twists[i].omega_radps - plan.twists[i - 1].omega_radps)});
  }
  for (std::size_t i = 0; i < plan.twists.size(); ++i) {
    all.push_back(sums[std::min(i + ahead, sums.size() - 1)]);
  }
  return all;
}

}  // namespace

std::vector<Pose2> planned(const TubePlan& plan) {
  std::vector<Pose2> poses{Pose2{}};
  for (const Twist& u : plan.twists) {
    poses.push_back(along_arc(poses.back(), u.v_mps * plan.step_s, u.omega_radps * plan.step_s));
  }
  return poses;
}

std::vector<double> reach_tube(const TubePlan& plan, const TubeBounds& bounds) {
  constexpr int kShares = 3, kTimes = 7;
  const std::vector<Pose2> to = planned(plan);
  const std::vector<Twist> variation = variations(plan, bounds.clock_s);
  std::vector<double> tube(to.size(), bounds.start_m);
  for (const Cell& clock : cells(-bounds.clock_s, bounds.clock_s, kTimes)) {
    for (const Cell& lag : cells(0.0, bounds.lag_s, kTimes)) {
      const std::vector<Twist> twists = followed(plan, clock.centre, lag.centre);
      for (const Cell& radius : cells(-bounds.radius, bounds.radius, kShares)) {
        for (const Cell& track : cells(-bounds.track, bounds.track, kShares)) {
          const CellOfBox cell{radius, track, clock, lag};
          Reach reach(plan, bounds, cell, twists);
          for (std::size_t k = 0; k < twists.size(); ++k) {
            reach.step(k, variation[k / kFiner]);
            if ((k + 1) % kFiner != 0) continue;
            const std::size_t i = (k + 1) / kFiner;
            tube[i] = std::max(tube[i], reach.farthest_m({to[i].x_m, to[i].y_m}));
          }
        }
      }
    }
  }
  return tube;
}

}  // namespace tether
