#pragma once

#include <optional>
#include <vector>

#include "common/path/reference_path.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "common/world/shape.hpp"

namespace tether {

/// A point of the path, and when the vehicle should be there.
struct TimedPoint {
  double t_s = 0.0;
  PathPoint point;
};

/// Something that moves by itself: where it is at some times, in order. Between them it goes
/// straight on at an even speed; before and after them it stands.
struct MovingShape {
  struct Place {
    double t_s, x_m, y_m;
  };
  Shape shape;  ///< at t = 0
  std::vector<Place> places;

  Pose2 at(double t_s) const;
};

/// Visible objects of a scenario. Messages say only where the vehicle is.
struct SceneSetting {
  double half_extent_m = 0.0;            ///< walls at ± this; 0: not known
  std::vector<Shape> obstacles = {};     ///< obstacles within the walls
  std::optional<VehicleConfig> vehicle;  ///< its shape; none: not known
  std::vector<TimedPoint> path;          ///< in order of time
  std::vector<MovingShape> moving = {};  ///< up to the run's end
};

/// At most this many points of a path, every 0.1 s or, of a long run, as often as that allows.
inline constexpr std::size_t kMostPathPoints = 2000;

/// So many places of what moves are kept, of all together; then it stands.
inline constexpr std::size_t kMostPlaces = 50'000;

/// Plans the path from t = 0 to run.duration_s. Throws UsageError as make_path() and
/// obstacle_shapes() do.
SceneSetting scene_setting(const Scenario& scenario);

}  // namespace tether
