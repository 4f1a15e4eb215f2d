#pragma once

#include <memory>
#include <vector>

#include "common/path/reference_path.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// A timed path by its arc length: how a vehicle says where it is on it
/// (autonomy_state_t::path_s_m). It learns the path's timing as far as it is asked. Not for several
/// threads.
class PathPlaces {
 public:
  static constexpr double kApart_m = 0.1;

  explicit PathPlaces(std::shared_ptr<const ReferencePath> path) : path_(std::move(path)) {}

  /// Poses from `from_m` on, kApart_m or less apart, for `length_m` or to the path's end.
  std::vector<Pose2> poses(double from_m, double length_m);
  /// Whether the path has its end by there.
  bool ends_by(double s_m);

 private:
  struct Place {
    double s_m;
    Pose2 pose;
  };
  void learn(double until_m);

  std::shared_ptr<const ReferencePath> path_;
  std::vector<Place> places_;
  double t_s_ = 0.0;
  bool ended_ = false;
};

}  // namespace tether
