#include "sim/obstacles/near_obstacles.hpp"

#include <algorithm>
#include <cmath>

namespace tether {
namespace {

constexpr double kCell_m = 2.0;
constexpr double kMostCellsASide = 256.0;
/// So far beyond the vehicle's reach a cell knows what there is.
constexpr double kSight_m = 2.0;

}  // namespace

NearObstacles::NearObstacles(const VehicleConfig& vehicle, const WorldSettings& world,
                             const Surroundings& surroundings, std::uint64_t seed, double step_s,
                             double slack_m)
    : vehicle_(vehicle),
      half_extent_m_(world.half_extent_m),
      standing_(solid_shapes(surroundings)),
      moving_(surroundings, seed),
      fastest_mps_(std::max(moving_.fastest_mps(), surroundings.vehicles_mps)),
      reach_m_(reach_m(vehicle)) {
  const double turning_mps = vehicle.max_wheel_speed_mps * reach_m_ / (0.5 * vehicle.track_m);
  margin_m_ = slack_m + step_s * (vehicle.max_wheel_speed_mps + turning_mps + fastest_mps_);
  if (!standing_.empty()) fill_cells();
}

void NearObstacles::fill_cells() {
  const double side_m = 2.0 * half_extent_m_;
  const double count = std::clamp(std::ceil(side_m / kCell_m), 1.0, kMostCellsASide);
  cells_a_side_ = static_cast<std::size_t>(count);
  cell_m_ = side_m / count;
  cells_.resize(cells_a_side_ * cells_a_side_);
  const double reach_m = reach_m_ + margin_m_ + kSight_m + cell_m_ / std::sqrt(2.0);
  for (std::uint32_t i = 0; i < standing_.size(); ++i) {
    const Shape& shape = standing_[i];
    const double extent_m = shape.outline == Shape::Outline::circle
                                ? shape.radius_m
                                : 0.5 * std::hypot(shape.length_m, shape.width_m);
    const auto cell = [&](double place_m, double off_m) { return cell_of(place_m + off_m); };
    const double off_m = extent_m + reach_m;
    for (std::size_t y = cell(shape.pose.y_m, -off_m); y <= cell(shape.pose.y_m, off_m); ++y) {
      for (std::size_t x = cell(shape.pose.x_m, -off_m); x <= cell(shape.pose.x_m, off_m); ++x) {
        const Position middle{(static_cast<double>(x) + 0.5) * cell_m_ - half_extent_m_,
                              (static_cast<double>(y) + 0.5) * cell_m_ - half_extent_m_};
        if (distance_m(shape, middle) <= reach_m) cells_[y * cells_a_side_ + x].push_back(i);
      }
    }
  }
}

/// The vehicle may be a little outside, in a corner where it is pressed through a wall.
std::size_t NearObstacles::cell_of(double place_m) const {
  const double cell = std::floor((place_m + half_extent_m_) / cell_m_);
  return cell > 0.0 ? std::min(static_cast<std::size_t>(cell), cells_a_side_ - 1) : 0;
}

bool NearObstacles::is_still_clear(const Pose2& axle, double t_s) const {
  const double turned_rad = std::abs(wrap_angle(axle.yaw_rad - axle_.yaw_rad));
  const double left_m = clear_m_ - reach_m_ * turned_rad - fastest_mps_ * std::abs(t_s - t_s_);
  if (left_m <= 0.0) return false;
  const double dx = axle.x_m - axle_.x_m, dy = axle.y_m - axle_.y_m;
  return dx * dx + dy * dy < left_m * left_m;
}

void NearObstacles::look(const Pose2& axle, double t_s) {
  near_.clear();
  axle_ = axle;
  t_s_ = t_s;
  clear_m_ = kSight_m;
  const Footprint outline = footprint(vehicle_, axle);
  if (!standing_.empty()) {
    for (const std::uint32_t i : cells_[cell_of(axle.y_m) * cells_a_side_ + cell_of(axle.x_m)]) {
      consider(standing_[i], outline, axle);
    }
  }
  if (moving_.any()) {
    for (const Shape& shape : moving_.at(t_s)) consider(shape, outline, axle);
  }
  for (const Shape& shape : vehicles_) consider(shape, outline, axle);
}

void NearObstacles::consider(const Shape& shape, const Footprint& outline, const Pose2& axle) {
  double gap = distance_m(shape, {axle.x_m, axle.y_m}) - reach_m_;
  if (gap < std::max(0.0, clear_m_) + margin_m_) {
    gap = std::min(gap_m(outline[0], shape), gap_m(outline[1], shape));
  }
  clear_m_ = std::min(clear_m_, gap - margin_m_);
  if (gap <= margin_m_) near_.push_back(shape);
}

}  // namespace tether
