#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/path/check.hpp"
#include "common/path/limits.hpp"
#include "common/path/simple_curves.hpp"
#include "common/scenario/own_settings.hpp"
#include "common/scenario/section.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

/// [path]. Which keys a kind uses is said in its row of common/path/kinds.cpp.
struct PathSettings {
  /// Point of the vehicle that follows the path.
  enum class Point { axle, chassis };
  std::string kind = "figure_eight";  ///< the name of one of path_kinds()
  /// The axle's midpoint, or the chassis' centre (controlled_point.hpp).
  Point point = Point::axle;
  FigureEight::Config figure_eight;
  std::string csv;               ///< waypoints; relative to the scenario file
  double radius_m = 8.0;         ///< circle
  double length_m = 15.0;        ///< line; rounded_rectangle, along the start's heading
  double width_m = 10.0;         ///< rounded_rectangle, across the start's heading
  double corner_radius_m = 2.0;  ///< rounded_rectangle, the least
  bool clockwise = false;        ///< circle, rounded_rectangle
  Pose2 start;                   ///< circle, line, rounded_rectangle
  PathLimits limits;             ///< all but the figure eight
  double phase = 0.0;            ///< share of a lap at which it begins, in [0, 1]; closed paths
  double offset_x_m = 0.0;       ///< the whole path lies so far off
  double offset_y_m = 0.0;
  bool is_moved() const { return phase != 0.0 || offset_x_m != 0.0 || offset_y_m != 0.0; }
  OwnSettings own;  ///< settings of kinds with keys that no other kind has
};

/// Where a vehicle stands whose controlled point is where its path begins; that of the figure
/// eight, which begins at full speed, at the origin, as `vehicle` is turned. Throws UsageError as
/// make_path() does.
Pose2 start_on(const PathSettings& settings, const VehicleSettings& vehicle);

/// The limits that some sections put on a path.
using PathLimitsOf = std::function<std::vector<PathLimit>(const Scenario&)>;

/// `limits`: those of each part between the path and the wheels. The path must keep them all.
ScenarioSection path_section(const std::vector<PathLimitsOf>& limits);

/// The limits of the vehicle and its tyres.
std::vector<PathLimit> vehicle_path_limits(const Scenario& scenario);

}  // namespace tether
