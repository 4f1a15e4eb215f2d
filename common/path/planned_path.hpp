#pragma once

#include <memory>
#include <utility>

#include "common/path/curves/curve.hpp"
#include "common/path/limits.hpp"
#include "common/path/reference_path.hpp"
#include "common/path/speed_profile.hpp"

namespace tether {

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
