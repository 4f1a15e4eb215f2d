#include "sim/plant/near_obstacles.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tether {
namespace {

double dot(const Position& a, const Position& b) { return a.x_m * b.x_m + a.y_m * b.y_m; }
Position minus(const Position& a, const Position& b) { return {a.x_m - b.x_m, a.y_m - b.y_m}; }
Position left_of(const Position& a) { return {-a.y_m, a.x_m}; }
Position along(const Position& from, const Position& direction, double way_m) {
  return {from.x_m + way_m * direction.x_m, from.y_m + way_m * direction.y_m};
}

/// One side of a rectangle.
struct Side {
  Position middle;
  Position outward;  ///< unit vector
  double half_m = 0.0;
};

std::array<Side, 4> sides(const Shape& r) {
  const double c = std::cos(r.pose.yaw_rad), s = std::sin(r.pose.yaw_rad);
  const Position centre{r.pose.x_m, r.pose.y_m}, ahead{c, s}, left{-s, c};
  const double l = 0.5 * r.length_m, w = 0.5 * r.width_m;
  return {{{along(centre, ahead, l), ahead, w},
           {along(centre, left, w), left, l},
           {along(centre, ahead, -l), {-c, -s}, w},
           {along(centre, left, -w), {s, -c}, l}}};
}

/// The side that keeps the corners farthest away, and how far the nearest of them is.
std::pair<const Side*, double> parting(const std::array<Side, 4>& sides,
                                       const std::array<Position, 4>& corners) {
  std::pair<const Side*, double> best{nullptr, 0.0};
  for (const Side& side : sides) {
    double gap = dot(side.outward, minus(corners[0], side.middle));
    for (const Position& corner : corners) {
      gap = std::min(gap, dot(side.outward, minus(corner, side.middle)));
    }
    if (best.first == nullptr || gap > best.second) best = {&side, gap};
  }
  return best;
}

const Side& facing(const std::array<Side, 4>& sides, const Position& outward) {
  return *std::min_element(sides.begin(), sides.end(), [&](const Side& a, const Side& b) {
    return dot(a.outward, outward) < dot(b.outward, outward);
  });
}

/// The ends of what `other` has in common with `side`, seen along it.
void add_common_part(const Side& side, const Side& other, Touch& touch) {
  const Position t = left_of(side.outward), along_other = left_of(other.outward);
  const Position ends[2] = {along(other.middle, along_other, -other.half_m),
                            along(other.middle, along_other, other.half_m)};
  const double from = dot(t, minus(ends[0], side.middle)), to = dot(t, minus(ends[1], side.middle));
  const auto add_at = [&](double place) {
    const double share = to == from ? 0.5 : std::clamp((place - from) / (to - from), 0.0, 1.0);
    const Position at = along(ends[0], minus(ends[1], ends[0]), share);
    touch.add({at, dot(side.outward, minus(at, side.middle))});
  };
  const double low = std::clamp(std::min(from, to), -side.half_m, side.half_m);
  const double high = std::clamp(std::max(from, to), -side.half_m, side.half_m);
  add_at(low);
  if (high > low) add_at(high);
}

Touch touch_circle(const Shape& rectangle, const Shape& circle) {
  const Position centre{circle.pose.x_m, circle.pose.y_m};
  const double c = std::cos(rectangle.pose.yaw_rad), s = std::sin(rectangle.pose.yaw_rad);
  const Position ahead{c, s}, left{-s, c}, middle{rectangle.pose.x_m, rectangle.pose.y_m};
  const Position from_middle = minus(centre, middle);
  const double l = 0.5 * rectangle.length_m, w = 0.5 * rectangle.width_m;
  const double x = dot(ahead, from_middle), y = dot(left, from_middle);
  if (std::abs(x) > l || std::abs(y) > w) {
    const Position nearest =
        along(along(middle, ahead, std::clamp(x, -l, l)), left, std::clamp(y, -w, w));
    const Position way = minus(centre, nearest);
    const double way_m = std::hypot(way.x_m, way.y_m);
    Touch touch({way.x_m / way_m, way.y_m / way_m}, way_m - circle.radius_m);
    touch.add({nearest, touch.gap_m()});
    return touch;
  }
  // The centre is within the rectangle: out through the nearest side.
  const auto all = sides(rectangle);
  const auto [side, gap] = parting(all, {centre, centre, centre, centre});
  Touch touch(side->outward, gap - circle.radius_m);
  touch.add({along(centre, side->outward, -gap), touch.gap_m()});
  return touch;
}

}  // namespace

Touch touch(const Shape& rectangle, const Shape& other) {
  if (other.outline == Shape::Outline::circle) return touch_circle(rectangle, other);
  const auto first = sides(rectangle), second = sides(other);
  const auto by_first = parting(first, corners(other));
  const auto by_second = parting(second, corners(rectangle));
  if (by_first.second > by_second.second) {
    Touch touch(by_first.first->outward, by_first.second);
    add_common_part(*by_first.first, facing(second, touch.normal()), touch);
    return touch;
  }
  const Position& outward = by_second.first->outward;
  Touch touch({-outward.x_m, -outward.y_m}, by_second.second);
  add_common_part(*by_second.first, facing(first, outward), touch);
  return touch;
}

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
