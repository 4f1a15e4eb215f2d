#include "common/path/planned_path.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/base/errors.hpp"

namespace tether {
namespace {

constexpr double kStep_m = 0.05;
constexpr double kFewestSteps = 200.0, kMostSteps = 500'000.0;
constexpr std::size_t kLongestRunUp = 2'000'000;  // steps

std::size_t steps_of(const PathCurve& curve) {
  const double steps = std::ceil(curve.length_m() / kStep_m);
  return static_cast<std::size_t>(std::clamp(steps, kFewestSteps, kMostSteps));
}

/// The limits at one step, whatever is before and after it.
struct Cap {
  double square = 0.0;        ///< square of the speed, m²/s²
  double acceleration = 0.0;  ///< m/s²
  double deceleration = 0.0;  ///< m/s²
};

/// The largest magnitudes within one step of each step, of samples at half steps.
struct Bends {
  std::vector<double> curvature, change;  ///< |κ| and |dκ/ds|
};

Bends bends_of(const PathCurve& curve, std::size_t steps) {
  const std::size_t halves = 2 * steps;
  const double half_m = curve.length_m() / static_cast<double>(halves);
  std::vector<double> curvature(halves + 1);
  for (std::size_t j = 0; j <= halves; ++j) {
    curvature[j] = curve.at(static_cast<double>(j) * half_m).curvature_1pm;
  }
  // Around the ring, or no farther than the ends.
  const auto sample = [&](std::size_t i, int offset) {
    const auto all = static_cast<std::ptrdiff_t>(halves);
    const std::ptrdiff_t j = static_cast<std::ptrdiff_t>(2 * i) + offset;
    return curvature[static_cast<std::size_t>(
        curve.is_closed() ? (j + all) % all : std::clamp<std::ptrdiff_t>(j, 0, all))];
  };
  Bends bends;
  for (std::size_t i = 0; i <= steps; ++i) {
    double most = std::abs(sample(i, -2)), change = 0.0;
    for (int offset = -1; offset <= 2; ++offset) {
      const double here = sample(i, offset);
      // Not std::max alone: it would pass over NaN, which a cusp has.
      most = std::isfinite(here) ? std::max(most, std::abs(here)) : here;
      change = std::max(change, std::abs(here - sample(i, offset - 1)) / half_m);
    }
    // Between two samples it may rise as steeply as around them.
    bends.curvature.push_back(most + 0.5 * half_m * change);
    bends.change.push_back(change);
  }
  return bends;
}

[[noreturn]] void refuse_cusp(const PathCurve& curve, double s_m, double curvature_1pm) {
  const std::string source = curve.source(s_m);
  const CurvePoint p = curve.at(s_m);
  throw UsageError(fmt::format(
      "{}{}the path bends with a radius of {:.4f} m, {:.2f} m from its start, at ({:.2f}, {:.2f}) "
      "m: path.max_yaw_rate_radps and path.max_lateral_acceleration_mps2 leave less than {} m/s",
      source, source.empty() ? "" : ": ", 1.0 / curvature_1pm, s_m, p.x_m, p.y_m,
      SpeedProfile::kSlowest_mps));
}

std::vector<Cap> caps_of(const PathCurve& curve, const PathLimits& limits, std::size_t steps) {
  const Bends bends = bends_of(curve, steps);
  const double step_m = curve.length_m() / static_cast<double>(steps);
  const double half_yaw = 0.5 * limits.max_yaw_acceleration_radps2;
  std::vector<Cap> caps;
  for (std::size_t i = 0; i <= steps; ++i) {
    const double s_m = static_cast<double>(i) * step_m;
    const double bend = bends.curvature[i];
    const double by_yaw_rate = limits.max_yaw_rate_radps / bend;
    const double by_bend =
        std::min(by_yaw_rate * by_yaw_rate, limits.max_lateral_acceleration_mps2 / bend);
    constexpr double kLeast = SpeedProfile::kSlowest_mps * SpeedProfile::kSlowest_mps;
    if (!(by_bend >= kLeast)) refuse_cusp(curve, s_m, bend);
    const double wanted = std::min(limits.speed_mps, curve.wanted_speed_mps(s_m));
    // A change of curvature alone never stops the vehicle.
    const double by_change = std::max(kLeast, half_yaw / bends.change[i]);
    caps.push_back({std::min({wanted * wanted, by_bend, by_change}),
                    std::min(limits.max_acceleration_mps2, half_yaw / bend),
                    std::min(limits.max_deceleration_mps2, half_yaw / bend)});
  }
  return caps;
}

double faster(const Cap& from, const Cap& to, double step_m) {
  return 2.0 * std::min(from.acceleration, to.acceleration) * step_m;
}

double slower(const Cap& from, const Cap& to, double step_m) {
  return 2.0 * std::min(from.deceleration, to.deceleration) * step_m;
}

/// Both passes, from step `first` on; around the ring if closed.
void limit_changes(std::vector<Cap>& caps, bool closed, std::size_t first, double step_m) {
  const std::size_t steps = caps.size() - 1;
  const auto at = [&](std::size_t i) -> Cap& { return caps[closed ? (first + i) % steps : i]; };
  for (std::size_t i = 0; i < steps; ++i) {
    Cap& to = at(i + 1);
    to.square = std::min(to.square, at(i).square + faster(at(i), to, step_m));
  }
  for (std::size_t i = steps; i-- > 0;) {
    Cap& from = at(i);
    from.square = std::min(from.square, at(i + 1).square + slower(from, at(i + 1), step_m));
  }
  if (closed) caps.back() = caps.front();
}

/// The next step after `from`, with the given square of its speed.
SpeedProfile::Motion next_step(const SpeedProfile::Motion& from, double step_m, double square) {
  const double v_mps = std::sqrt(square);
  return {from.t_s + 2.0 * step_m / (from.v_mps + v_mps), from.s_m + step_m, v_mps};
}

}  // namespace

SpeedProfile::SpeedProfile(const PathCurve& curve, const PathLimits& limits)
    : length_m_(curve.length_m()) {
  const std::size_t steps = steps_of(curve);
  const double step_m = length_m_ / static_cast<double>(steps);
  std::vector<Cap> caps = caps_of(curve, limits, steps);
  std::size_t slowest = 0;
  if (curve.is_closed()) {
    caps.front().square = caps.back().square = std::min(caps.front().square, caps.back().square);
    const auto less = [](const Cap& a, const Cap& b) { return a.square < b.square; };
    slowest = static_cast<std::size_t>(std::min_element(caps.begin(), caps.end() - 1, less) -
                                       caps.begin());
  } else {
    caps.front().square = caps.back().square = 0.0;
  }
  limit_changes(caps, curve.is_closed(), slowest, step_m);

  first_.push_back({});
  double square = 0.0;
  std::size_t i = 0;  // in caps
  const auto joined = [&] { return curve.is_closed() ? square >= caps[i].square : i == steps; };
  while (!joined()) {
    const Cap& next = caps[i + 1];
    square = std::min(next.square, square + faster(caps[i], next, step_m));
    if (first_.size() == kLongestRunUp) {
      throw UsageError(
          fmt::format("path.max_acceleration_mps2 = {} is too little to ever reach path.speed_mps "
                      "= {}: more than {} m",
                      limits.max_acceleration_mps2, limits.speed_mps, first_.back().s_m));
    }
    first_.push_back(next_step(first_.back(), step_m, square));
    if (++i == steps && curve.is_closed()) i = 0;
  }
  if (!curve.is_closed()) return;
  lap_.push_back({0.0, 0.0, std::sqrt(caps.front().square)});
  for (std::size_t k = 1; k <= steps; ++k) {
    lap_.push_back(next_step(lap_.back(), step_m, caps[k].square));
  }
  into_lap_s_ = lap_[i].t_s;
}

SpeedProfile::Motion SpeedProfile::within(const std::vector<Motion>& steps, double t_s) const {
  const auto after = std::upper_bound(steps.begin() + 1, steps.end() - 1, t_s,
                                      [](double t, const Motion& step) { return t < step.t_s; });
  const Motion &from = *(after - 1), &to = *after;
  const double past_s = std::min(t_s - from.t_s, to.t_s - from.t_s);
  const double a_mps2 = (to.v_mps - from.v_mps) / (to.t_s - from.t_s);
  const double s_m = from.s_m + (from.v_mps + 0.5 * a_mps2 * past_s) * past_s;
  return {t_s, std::min(s_m, to.s_m), from.v_mps + a_mps2 * past_s};
}

SpeedProfile::Motion SpeedProfile::at(double t_s) const {
  if (t_s <= 0.0) return {t_s, 0.0, 0.0};
  if (t_s < first_s()) {
    Motion motion = within(first_, t_s);
    if (!lap_.empty()) motion.s_m = std::fmod(motion.s_m, length_m_);
    return motion;
  }
  if (lap_.empty()) return {t_s, length_m_, 0.0};
  Motion motion = within(lap_, std::fmod(t_s - first_s() + into_lap_s_, lap_s()));
  motion.t_s = t_s;
  return motion;
}

std::vector<SpeedProfile::Motion> SpeedProfile::steps() const {
  std::vector<Motion> all = first_;
  if (lap_.empty()) return all;
  for (Motion& step : all) step.s_m = std::fmod(step.s_m, length_m_);
  // The flying lap from where it is joined, around to there.
  const auto joins = std::lower_bound(lap_.begin(), lap_.end(), into_lap_s_,
                                      [](const Motion& step, double t) { return step.t_s < t; });
  const auto add = [&all](std::vector<Motion>::const_iterator from,
                          std::vector<Motion>::const_iterator to, double shift_s) {
    for (; from != to; ++from) all.push_back({from->t_s + shift_s, from->s_m, from->v_mps});
  };
  const double shift_s = first_s() - into_lap_s_;
  add(joins + 1, lap_.end(), shift_s);
  add(lap_.begin() + 1, joins + 1, shift_s + lap_s());
  return all;
}

PathPoint PlannedPath::point(const SpeedProfile::Motion& motion) const {
  const CurvePoint p = curve_->at(motion.s_m);
  return {p.x_m, p.y_m, p.yaw_rad, motion.v_mps, motion.v_mps * p.curvature_1pm};
}

}  // namespace tether
