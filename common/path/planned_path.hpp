#pragma once

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "common/path/curve.hpp"
#include "common/path/limits.hpp"
#include "common/path/reference_path.hpp"

namespace tether {

/// When to be where on a curve: as fast as the limits allow, from rest.
///
/// The speed is limited at even steps of arc length, of 5 cm or less, by cruise speed, wish and
/// curvature κ:
/// - v ≤ speed, v² |κ| ≤ lateral limit, v |κ| ≤ yaw-rate limit;
/// - v² |dκ/ds| ≤ ½ yaw-acceleration limit.
/// Then a pass forwards, v² ≤ v₋² + 2 a Δs, limits the acceleration, and one backwards the
/// deceleration, each also to |κ| a ≤ ½ yaw-acceleration limit. (Bobrow, Dubowsky and Gibson 1985,
/// for a vehicle.)
/// Between the steps the acceleration is constant, so that s(t) and v(t) are exact there.
///
/// Open curves end at rest. Closed ones go on lap after lap: the first begins at rest and speeds up
/// until it meets the flying lap, which repeats itself ever after.
class SpeedProfile {
 public:
  /// Where on the curve, and how fast.
  struct Motion {
    double t_s = 0.0;
    double s_m = 0.0;  ///< in [0, length]; of closed curves: since the present lap's start
    double v_mps = 0.0;
  };

  /// The slowest that a curvature may demand.
  static constexpr double kSlowest_mps = 0.05;

  /// Throws UsageError where the curve is so sharp that less than kSlowest_mps would be left.
  SpeedProfile(const PathCurve& curve, const PathLimits& limits);

  /// Before t = 0: at rest at the start.
  Motion at(double t_s) const;

  /// To the end; of closed curves: until the flying lap begins.
  double first_s() const { return first_.back().t_s; }
  double lap_s() const { return lap_.empty() ? 0.0 : lap_.back().t_s; }  ///< closed: a flying lap

  /// All the steps, in order: to the end, or until the first flying lap is over.
  std::vector<Motion> steps() const;

 private:
  Motion within(const std::vector<Motion>& steps, double t_s) const;

  double length_m_;
  std::vector<Motion> first_;  ///< from rest; its s goes on rising in later laps
  std::vector<Motion> lap_;    ///< lap of closed curves, from s = 0; flying
  double into_lap_s_ = 0.0;    ///< the flying lap's time at which first_ joins it
};

/// A curve with a speed profile. Its arc length at any time is in closed form: no rounding errors
/// add up, so that nothing drifts from lap to lap.
class PlannedPath final : public ReferencePath {
 public:
  /// Throws UsageError where no profile exists.
  PlannedPath(std::unique_ptr<const PathCurve> curve, const PathLimits& limits)
      : curve_(std::move(curve)), profile_(*curve_, limits) {}

  PathPoint at(double t_s) const override { return point(profile_.at(t_s)); }
  PathPoint point(const SpeedProfile::Motion& motion) const;

  const PathCurve& curve() const { return *curve_; }
  const SpeedProfile& profile() const { return profile_; }

 private:
  std::unique_ptr<const PathCurve> curve_;
  SpeedProfile profile_;
};

}  // namespace tether
