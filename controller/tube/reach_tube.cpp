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

constexpr int kDirections = 12;  // number on half a circle; their opposites are used, too
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

/// A change of the twist, `at_s` after the silence began.
struct Jump {
  double at_s;
  Twist by;
};

std::vector<Jump> jumps_of(const TubePlan& plan) {
  std::vector<Jump> all;
  for (std::size_t i = 1; i < plan.twists.size(); ++i) {
    const Twist &from = plan.twists[i - 1], &to = plan.twists[i];
    all.push_back({(static_cast<double>(i) - static_cast<double>(plan.before)) * plan.step_s,
                   {to.v_mps - from.v_mps, to.omega_radps - from.omega_radps}});
  }
  return all;
}

/// Integral of the difference that a low-pass still has from a unit jump `ago_s` ago.
double yet_to_do_s(double ago_s, double lag_s) {
  if (ago_s < 0.0) return lag_s - ago_s;
  return lag_s > 0.0 ? lag_s * std::exp(-ago_s / lag_s) : 0.0;
}

/// Share of that jump that the low-pass has not followed yet.
double share_left(double ago_s, double lag_s) {
  if (ago_s <= 0.0) return 1.0;
  return lag_s > 0.0 ? std::exp(-ago_s / lag_s) : 0.0;
}

/// The twist that a drive with a clock and a lag is at, in the middle of each fine step.
std::vector<Twist> followed(const TubePlan& plan, const std::vector<Jump>& jumps, double clock_s,
                            double lag_s) {
  const double dt_s = plan.step_s / kFiner;
  const double keep = lag_s > 0.0 ? std::exp(-dt_s / lag_s) : 0.0;
  Twist is = plan.twists.front();
  for (const Jump& jump : jumps) {
    const double done = 1.0 - share_left(clock_s - jump.at_s, lag_s);
    is = {is.v_mps + done * jump.by.v_mps, is.omega_radps + done * jump.by.omega_radps};
  }
  std::vector<Twist> all;
  for (std::size_t k = 0; k < plan.steps() * kFiner; ++k) {
    const Twist& to = plan.at((static_cast<double>(k) + 0.5) * dt_s + clock_s);
    is = {to.v_mps + keep * (is.v_mps - to.v_mps),
          to.omega_radps + keep * (is.omega_radps - to.omega_radps)};
    all.push_back(is);
  }
  return all;
}

/// How far way and heading can be from those of a cell's centre up to the end of each of the plan's
/// steps, by shifts in time, lags and what was left: m and rad, as a twist in force for a second.
std::vector<Twist> shifts(const TubePlan& plan, const std::vector<Jump>& jumps,
                          const TubeBounds& bounds, const Cell& clock, const Cell& lag) {
  const double slow_s = lag.centre + lag.half, fast_s = std::max(0.0, lag.centre - lag.half);
  const double fine_s = plan.step_s / kFiner;  // for switching within one
  Twist sum{bounds.left_mps * (slow_s + bounds.slewing_s),
            bounds.left_radps * (slow_s + bounds.slewing_s)};
  std::vector<Twist> all;
  auto next = jumps.begin();
  for (std::size_t i = 1; i <= plan.steps(); ++i) {
    const double reached_s = static_cast<double>(i) * plan.step_s + bounds.clock_s + fine_s;
    for (; next != jumps.end() && next->at_s < reached_s; ++next) {
      const double ago_s = clock.centre - next->at_s;
      // Earlier plans sampled the path at other times, each change at most a step from here.
      const bool past = next->at_s <= 0.0;
      const double late_s =
          past ? std::max(clock.centre, ago_s - plan.step_s) - clock.half : ago_s - clock.half;
      const double early_s = ago_s + clock.half + (past ? plan.step_s : 0.0);
      const double middle_s = yet_to_do_s(ago_s, lag.centre);
      const double off_s = std::max(yet_to_do_s(late_s, slow_s) - middle_s,
                                    middle_s - yet_to_do_s(early_s, fast_s)) +
                           bounds.slewing_s * share_left(late_s - bounds.slewing_s, slow_s) +
                           fine_s * share_left(late_s - fine_s, slow_s);
      sum.v_mps += off_s * std::abs(next->by.v_mps);
      sum.omega_radps += off_s * std::abs(next->by.omega_radps);
    }
    all.push_back(sum);
  }
  return all;
}

struct CellOfBox {
  Cell radius, track;
};

/// Set reachable from one cell, during its integration.
class Reach {
 public:
  Reach(const TubePlan& plan, const TubeBounds& bounds, const CellOfBox& cell,
        const std::vector<Twist>& followed)
      : b_(bounds), cell_(cell), followed_(followed), dt_s_(plan.step_s / kFiner) {
    larger_ = 1.0 + cell.radius.centre;
    wider_ = 1.0 + cell.track.centre;
    for (int i = 0; i < kDirections; ++i) {
      const double angle = std::numbers::pi * i / kDirections;
      directions_[static_cast<std::size_t>(i)] = {std::cos(angle), std::sin(angle)};
    }
  }

  /// `shift`: shifts() up to the end of this fine step.
  void step(std::size_t k, const Twist& shift) {
    const Twist& w = followed_[k];
    const double v = larger_ * w.v_mps, omega = larger_ * wider_ * w.omega_radps;
    const Vector2d moved = arc(yaw_rad_, v, omega, dt_s_);
    const double speed_m = std::abs(v) * dt_s_;
    const double most_larger = larger_ + cell_.radius.half, most_wider = wider_ + cell_.track.half;
    const double turned_rad = std::abs(swept_rad_) + 0.5 * std::abs(w.omega_radps) * dt_s_;
    // Headings: linear parts, those of shifts, and of second order.
    const double of_radius = cell_.radius.half * wider_, of_track = cell_.track.half * larger_;
    const double shifted_rad = shift.omega_radps * most_larger * most_wider;
    const double second_rad = cell_.radius.half * cell_.track.half * turned_rad;
    const double time_s = (static_cast<double>(k) + 1.0) * dt_s_;
    const double heading_rad = b_.start_rad + (of_radius + of_track) * turned_rad + shifted_rad +
                               second_rad + b_.yaw_radps * time_s;
    const double nu = cell_.radius.half * std::abs(w.v_mps) + b_.speed_mps;
    ball_m_ += speed_m * (shifted_rad + second_rad + 0.5 * heading_rad * heading_rad) +
               nu * dt_s_ * heading_rad;
    shifted_m_ = shift.v_mps * most_larger * (1.0 + heading_rad);
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

  /// Support function for a yaw rate of 1 rad/s whose sign may change: what turns at s moves all
  /// that comes after. Between two places the way bulges by no more than |v ω| Δ²/8.
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
  double dt_s_, larger_, wider_;
  std::array<Vector2d, kDirections> directions_;
  std::array<double, kDirections> along_m_{};
  Vector2d place_ = Vector2d::Zero(), by_radius_ = Vector2d::Zero(), by_track_ = Vector2d::Zero();
  double yaw_rad_ = 0.0, swept_rad_ = 0.0;
  double ball_m_ = 0.0, shifted_m_ = 0.0;
  double lateral_mps2_ = 0.0;  // greatest |v ω|, m/s²
  std::vector<Vector2d> places_;
};

}  // namespace

const Twist& TubePlan::at(double t_s) const {
  const auto i =
      static_cast<std::ptrdiff_t>(std::floor(t_s / step_s)) + static_cast<std::ptrdiff_t>(before);
  const auto last = static_cast<std::ptrdiff_t>(twists.size()) - 1;
  return twists[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(i, 0, last))];
}

std::vector<Pose2> planned(const TubePlan& plan) {
  std::vector<Pose2> poses{Pose2{}};
  for (std::size_t i = plan.before; i < plan.before + plan.steps(); ++i) {
    const Twist& u = plan.twists[i];
    poses.push_back(along_arc(poses.back(), u.v_mps * plan.step_s, u.omega_radps * plan.step_s));
  }
  return poses;
}

std::vector<double> reach_tube(const TubePlan& plan, const TubeBounds& bounds) {
  constexpr int kShares = 3, kTimes = 7;
  const std::vector<Pose2> to = planned(plan);
  const std::vector<Jump> jumps = jumps_of(plan);
  std::vector<double> tube(to.size(), bounds.start_m);
  for (const Cell& clock : cells(-bounds.clock_s, bounds.clock_s, kTimes)) {
    for (const Cell& lag : cells(0.0, bounds.lag_s, kTimes)) {
      const std::vector<Twist> twists = followed(plan, jumps, clock.centre, lag.centre);
      const std::vector<Twist> shift = shifts(plan, jumps, bounds, clock, lag);
      for (const Cell& radius : cells(-bounds.radius, bounds.radius, kShares)) {
        for (const Cell& track : cells(-bounds.track, bounds.track, kShares)) {
          const CellOfBox cell{radius, track};
          Reach reach(plan, bounds, cell, twists);
          for (std::size_t k = 0; k < twists.size(); ++k) {
            reach.step(k, shift[k / kFiner]);
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
