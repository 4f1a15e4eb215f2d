#include "sim/sensor/lidar_model.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace tether {

LidarModel::LidarModel(const LidarSettings& settings, const VehicleConfig& vehicle,
                       const std::vector<Shape>& standing, std::uint64_t seed,
                       const std::string& name)
    : settings_(settings),
      mount_(settings.mount(vehicle)),
      hidden_(hidden_beams(settings, vehicle)),
      caster_(standing, settings.height_m),
      least_light_(0.1 / (settings.range_10_m * settings.range_10_m)),
      noise_random_(random_stream(seed, name + "/lidar/noise")),
      dropout_random_(random_stream(seed, name + "/lidar/dropouts")) {}

Scan LidarModel::turn(Instant first_beam, const PoseTrack& track,
                      const std::vector<Shape>& moving) {
  Scan scan;
  scan.stamp = first_beam;
  scan.seq = seq_++;
  scan.mount = mount_;
  scan.angle_min_rad = settings_.angle_min_rad();
  scan.angle_increment_rad = settings_.angle_increment_rad();
  scan.time_increment_s = settings_.time_increment_s();
  scan.range_min_m = settings_.range_min_m;
  scan.range_max_m = settings_.range_max_m;
  scan.range_m.resize(static_cast<std::size_t>(settings_.beams));
  aim(scan, track);
  caster_.set_moving(moving);
  for (RayFan* fan : {&middle_, &right_, &left_}) caster_.cast(*fan, settings_.range_max_m);

  const double step_m = settings_.range_step_m;
  for (std::size_t i = 0; i < scan.range_m.size(); ++i) {
    const double normal = normal_(noise_random_);
    const bool dropped =
        settings_.dropout_share > 0.0 && uniform_01(dropout_random_) < settings_.dropout_share;
    if (dropped || hidden_[i]) continue;
    const double true_m = seen_range_m(i);
    if (true_m == RayFan::kNothing) continue;
    double range_m =
        true_m + normal * std::hypot(settings_.noise_m, settings_.noise_per_m * true_m);
    if (step_m > 0.0) range_m = step_m * std::round(range_m / step_m);
    if (range_m < settings_.range_min_m || range_m > settings_.range_max_m) continue;
    scan.range_m[i] = static_cast<float>(std::max(range_m, 0.0));
  }
  return scan;
}

void LidarModel::aim(const Scan& scan, const PoseTrack& track) {
  const double third_rad = settings_.divergence_rad / 3.0;
  for (RayFan* fan : {&middle_, &right_, &left_}) fan->clear();
  double yaw_rad = 0.0;
  std::size_t near = 0;
  for (std::size_t i = 0; i < scan.range_m.size(); ++i) {
    const Pose2 vehicle = track.at(scan.time_of(i), near);
    yaw_rad = i == 0 ? vehicle.yaw_rad : yaw_rad + wrap_angle(vehicle.yaw_rad - yaw_rad);
    const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
    const Position from{vehicle.x_m + c * mount_.x_m - s * mount_.y_m,
                        vehicle.y_m + s * mount_.x_m + c * mount_.y_m};
    const double angle_rad = yaw_rad + mount_.yaw_rad + scan.angle_rad(i);
    const double time_s = scan.time_increment_s * static_cast<double>(i);
    middle_.add(from, angle_rad, time_s);
    if (third_rad == 0.0) continue;
    right_.add(from, angle_rad - third_rad, time_s);
    left_.add(from, angle_rad + third_rad, time_s);
  }
}

/// Light that comes back along a ray; 0 if it meets nothing.
double LidarModel::light(const RayFan& fan, std::size_t ray) const {
  if (fan.shape[ray] == RayFan::kNoShape) return 0.0;
  const RayHit hit = caster_.hit(fan, ray);
  const double r_m = std::max(fan.range_m[ray], 1e-3);
  return hit.reflectivity * hit.cos_incidence / (r_m * r_m);
}

double LidarModel::seen_range_m(std::size_t beam) const {
  const bool one_shape = right_.size() == 0 || (right_.shape[beam] == middle_.shape[beam] &&
                                                left_.shape[beam] == middle_.shape[beam]);
  if (!one_shape) return mixed_range_m(beam);
  if (light(middle_, beam) < least_light_) return RayFan::kNothing;
  return middle_.range_m[beam];
}

double LidarModel::mixed_range_m(std::size_t beam) const {
  struct Third {
    double range_m, light;
  };
  std::array<Third, 3> thirds{};
  const std::array<const RayFan*, 3> fans{&right_, &middle_, &left_};
  for (std::size_t k = 0; k < 3; ++k) {
    thirds[k] = {fans[k]->range_m[beam], light(*fans[k], beam) / 3.0};
  }
  std::sort(thirds.begin(), thirds.end(),
            [](const Third& a, const Third& b) { return a.range_m < b.range_m; });
  for (std::size_t first = 0; first < 3;) {
    double light = 0.0, weighted_m = 0.0;
    std::size_t k = first;
    for (; k < 3 && thirds[k].range_m <= thirds[first].range_m + kPulse_m; ++k) {
      light += thirds[k].light;
      weighted_m += thirds[k].light * thirds[k].range_m;
    }
    if (light > 0.0 && light >= least_light_) return weighted_m / light;
    first = std::max(k, first + 1);
  }
  return RayFan::kNothing;
}

}  // namespace tether
