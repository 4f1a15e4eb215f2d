#include "sim/sensor/ray_caster.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace tether {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kSkin_m = 1e-9;

/// The direction of (x, y), other than (0, 0), to within kDirectionError_rad (Abramowitz and
/// Stegun, Handbook of Mathematical Functions, 4.4.47): a third of what std::atan2 takes.
double direction_of(double x, double y) {
  const double large = std::max(std::abs(x), std::abs(y));
  const double z = std::min(std::abs(x), std::abs(y)) / large, z2 = z * z;
  double angle_rad =
      z * (0.9998660 + z2 * (-0.3302995 + z2 * (0.1801410 + z2 * (-0.0851330 + z2 * 0.0208351))));
  angle_rad = std::abs(y) > std::abs(x) ? 0.5 * kPi - angle_rad : angle_rad;
  angle_rad = x < 0.0 ? kPi - angle_rad : angle_rad;
  return std::copysign(angle_rad, y);
}
constexpr double kDirectionError_rad = 1.2e-5;

/// A shape is small if its radius is less than this share of its distance: asin(x) < 1.01 x.
constexpr double kSmall = 0.2;

/// Shapes narrower than twice this contain nothing: a wall, a cell of a map.
constexpr double kLarge_m = 0.2;

}  // namespace

/// A fan as shapes of one velocity see it, who take themselves to stand.
class RayCaster::View {
 public:
  /// `x_m`, `y_m`: the rays' origins.
  View(RayFan& fan, const double* x_m, const double* y_m, double max_m);

  void draw(const Outline& outline, std::int64_t shape);

 private:
  struct Rays {
    std::size_t begin, end;
  };

  void draw_near(const Outline& box, std::int64_t shape, double x, double y);
  void draw_within(const Outline& outline, std::int64_t shape, double from_rad, double to_rad);
  void cut(const Outline& outline, std::int64_t shape, Rays rays);
  void cut_box(const Outline& box, std::int64_t shape, Rays rays);
  void cut_circle(const Outline& circle, std::int64_t shape, Rays rays);

  RayFan& fan_;
  const double* x_m_;
  const double* y_m_;
  double max_m_;
  std::size_t rays_;
  Position centre_;        ///< centre of all origins, ....
  double spread_m_ = 0.0;  ///< ... none of which is farther from it
  double first_rad_;       ///< in [−π, π]
  double rays_per_rad_ = 1.0;
  double whole_rad_ = 0.0;   ///< from the first to the last
  double uneven_rad_ = 0.0;  ///< no direction is farther from where equal steps would have it
};

RayCaster::View::View(RayFan& fan, const double* x_m, const double* y_m, double max_m)
    : fan_(fan),
      x_m_(x_m),
      y_m_(y_m),
      max_m_(max_m),
      rays_(fan.size()),
      centre_{0.5 * (x_m[0] + x_m[rays_ - 1]), 0.5 * (y_m[0] + y_m[rays_ - 1])},
      first_rad_(std::remainder(fan.angle_rad.front(), 2.0 * kPi)) {
  whole_rad_ = fan.angle_rad.back() - fan.angle_rad.front();
  double step_rad = rays_ > 1 ? whole_rad_ / static_cast<double>(rays_ - 1) : 1.0;
  if (step_rad <= 0.0) step_rad = 1.0;  // it does not turn to the left: then it is uneven indeed
  rays_per_rad_ = 1.0 / step_rad;
  double farthest_m2 = 0.0;
  for (std::size_t i = 0; i < rays_; ++i) {
    const double x = x_m[i] - centre_.x_m, y = y_m[i] - centre_.y_m;
    farthest_m2 = std::max(farthest_m2, x * x + y * y);
    const double even_rad = fan.angle_rad.front() + step_rad * static_cast<double>(i);
    uneven_rad_ = std::max(uneven_rad_, std::abs(fan.angle_rad[i] - even_rad));
  }
  spread_m_ = std::sqrt(farthest_m2) + kSkin_m;
  uneven_rad_ += 2.0 * kDirectionError_rad;
  whole_rad_ += uneven_rad_;
}

void RayCaster::View::draw(const Outline& outline, std::int64_t shape) {
  const double x = outline.x_m - centre_.x_m, y = outline.y_m - centre_.y_m;
  const double distance_m = std::sqrt(x * x + y * y);
  const double reach_m = outline.reach_m + spread_m_;
  if (distance_m > reach_m + max_m_) return;
  if (reach_m >= kSmall * distance_m) return draw_near(outline, shape, x, y);
  const double middle_rad = direction_of(x, y), half_rad = 1.01 * reach_m / distance_m;
  draw_within(outline, shape, middle_rad - half_rad, middle_rad + half_rad);
}

/// `x`, `y`: of its centre, as seen from the fan's.
void RayCaster::View::draw_near(const Outline& o, std::int64_t shape, double x, double y) {
  // From the fan's centre to the outline's nearest point.
  const double beside_m = std::max(std::abs(o.c * x + o.s * y) - o.half_length_m, 0.0);
  const double before_m = std::max(std::abs(o.c * y - o.s * x) - o.half_width_m, 0.0);
  const double distance_m =
      o.is_circle() ? std::hypot(x, y) - o.half_length_m : std::hypot(beside_m, before_m);
  // Within it, perhaps, or so near that it covers half a turn.
  if (distance_m <= 2.0 * spread_m_ + kDirectionError_rad * o.reach_m) {
    return cut(o, shape, {0, rays_});
  }
  const double middle_rad = direction_of(x, y);
  const double parallax_rad = 0.5 * kPi * spread_m_ / distance_m;  // more than asin
  double low_rad = 0.0, high_rad = 0.0;
  if (o.is_circle()) {
    high_rad = std::asin(o.half_length_m / std::hypot(x, y));
    low_rad = -high_rad;
  }
  for (const double along : {-o.half_length_m, o.half_length_m}) {
    for (const double across : {-o.half_width_m, o.half_width_m}) {
      if (o.is_circle()) break;
      double corner_rad =
          direction_of(x + o.c * along - o.s * across, y + o.s * along + o.c * across) - middle_rad;
      if (corner_rad > kPi) corner_rad -= 2.0 * kPi;
      if (corner_rad < -kPi) corner_rad += 2.0 * kPi;
      low_rad = std::min(low_rad, corner_rad);
      high_rad = std::max(high_rad, corner_rad);
    }
  }
  draw_within(o, shape, middle_rad + low_rad - parallax_rad, middle_rad + high_rad + parallax_rad);
}

/// Cuts all rays whose direction may be in that interval.
void RayCaster::View::draw_within(const Outline& outline, std::int64_t shape, double from_rad,
                                  double to_rad) {
  constexpr double kTurn = 2.0 * kPi;
  const double width_rad = to_rad - from_rad + 2.0 * uneven_rad_;
  if (width_rad >= kTurn) return cut(outline, shape, {0, rays_});
  double begin_rad = from_rad - uneven_rad_ - first_rad_;  // from the first ray on
  while (begin_rad + width_rad >= kTurn) begin_rad -= kTurn;
  while (begin_rad + width_rad < 0.0) begin_rad += kTurn;
  for (; begin_rad <= whole_rad_; begin_rad += kTurn) {
    const auto begin = static_cast<std::size_t>(std::max(begin_rad, 0.0) * rays_per_rad_);
    const auto last = static_cast<std::size_t>((begin_rad + width_rad) * rays_per_rad_);
    cut(outline, shape, {begin, std::min(last + 1, rays_)});
  }
}

void RayCaster::View::cut(const Outline& outline, std::int64_t shape, Rays rays) {
  if (outline.is_circle()) {
    cut_circle(outline, shape, rays);
  } else {
    cut_box(outline, shape, rays);
  }
}

/// Without branches, which could not be predicted.
void RayCaster::View::cut_box(const Outline& box, std::int64_t shape, Rays rays) {
  const Outline o = box;
  const double* dx = fan_.dx.data();
  const double* dy = fan_.dy.data();
  double* range_m = fan_.range_m.data();
  std::int64_t* shapes = fan_.shape.data();
  for (std::size_t i = rays.begin; i < rays.end; ++i) {
    const double x = o.x_m - x_m_[i], y = o.y_m - y_m_[i];
    const double along = o.c * x + o.s * y, across = o.c * y - o.s * x;
    const double per_along = 1.0 / (o.c * dx[i] + o.s * dy[i]);
    const double per_across = 1.0 / (o.c * dy[i] - o.s * dx[i]);
    const double a = (along - o.half_length_m) * per_along;
    const double b = (along + o.half_length_m) * per_along;
    const double c = (across - o.half_width_m) * per_across;
    const double d = (across + o.half_width_m) * per_across;
    const double in_m = std::max(std::min(a, b), std::min(c, d));
    const double out_m = std::min(std::max(a, b), std::max(c, d));
    const double t = in_m >= 0.0 ? in_m : out_m;
    const bool first = (in_m <= out_m) & (t >= 0.0) & (t < range_m[i]);
    range_m[i] = first ? t : range_m[i];
    shapes[i] = first ? shape : shapes[i];
  }
}

void RayCaster::View::cut_circle(const Outline& circle, std::int64_t shape, Rays rays) {
  for (std::size_t i = rays.begin; i < rays.end; ++i) {
    const double x = circle.x_m - x_m_[i], y = circle.y_m - y_m_[i];
    const double along = x * fan_.dx[i] + y * fan_.dy[i], across = x * fan_.dy[i] - y * fan_.dx[i];
    const double half2 = circle.half_length_m * circle.half_length_m - across * across;
    if (half2 < 0.0) continue;
    const double half = std::sqrt(half2);
    const double t = along >= half ? along - half : along + half;
    if (t < 0.0 || t >= fan_.range_m[i]) continue;
    fan_.range_m[i] = t;
    fan_.shape[i] = shape;
  }
}

/// Whether all of it is within a larger one; in doubt not.
bool RayCaster::Outline::is_within(const Outline& larger) const {
  if (larger.reach_m <= reach_m) return false;
  const double x = x_m - larger.x_m, y = y_m - larger.y_m;
  if (larger.is_circle()) return std::hypot(x, y) + reach_m <= larger.half_length_m;
  const double cos_turn = std::abs(larger.c * c + larger.s * s);
  const double sin_turn = std::abs(larger.c * s - larger.s * c);
  const double along_m = is_circle() ? reach_m : cos_turn * half_length_m + sin_turn * half_width_m;
  const double across_m =
      is_circle() ? reach_m : sin_turn * half_length_m + cos_turn * half_width_m;
  return std::abs(larger.c * x + larger.s * y) + along_m <= larger.half_length_m + kSkin_m &&
         std::abs(larger.c * y - larger.s * x) + across_m <= larger.half_width_m + kSkin_m;
}

RayCaster::RayCaster(const std::vector<Shape>& standing, double height_m) : height_m_(height_m) {
  const std::vector<Outline> all = outlines_of(standing);
  std::vector<Outline> large;
  for (const Outline& o : all) {
    const double width_m = o.is_circle() ? o.half_length_m : o.half_width_m;
    if (std::min(o.half_length_m, width_m) >= kLarge_m) large.push_back(o);
  }
  for (Outline outline : all) {
    outline.vx_mps = outline.vy_mps = 0.0;
    const bool inside = std::any_of(large.begin(), large.end(),
                                    [&](const Outline& o) { return outline.is_within(o); });
    if (!inside) standing_.push_back(outline);
  }
}

std::vector<RayCaster::Outline> RayCaster::outlines_of(const std::vector<Shape>& shapes) const {
  std::vector<Outline> outlines;
  for (const Shape& shape : shapes) {
    if (!shape.is_at(height_m_)) continue;
    const bool circle = shape.outline == Shape::Outline::circle;
    const double length_m = circle ? shape.radius_m : 0.5 * shape.length_m;
    const double width_m = circle ? 0.0 : std::max(0.5 * shape.width_m, kSkin_m);
    outlines.push_back({shape.pose.x_m, shape.pose.y_m, std::cos(shape.pose.yaw_rad),
                        std::sin(shape.pose.yaw_rad), length_m, width_m,
                        std::hypot(length_m, width_m), shape.reflectivity, shape.vx_mps,
                        shape.vy_mps});
  }
  return outlines;
}

void RayCaster::set_moving(const std::vector<Shape>& shapes) { moving_ = outlines_of(shapes); }

void RayCaster::cast(RayFan& fan, double max_m) const {
  if (fan.size() == 0) return;
  std::fill(fan.range_m.begin(), fan.range_m.end(), max_m);
  std::fill(fan.shape.begin(), fan.shape.end(), RayFan::kNoShape);
  std::int64_t shape = 0;
  View view(fan, fan.x_m.data(), fan.y_m.data(), max_m);
  for (const Outline& outline : standing_) view.draw(outline, shape++);

  for (const Outline& outline : moving_) {
    for (std::size_t i = 0; i < fan.size(); ++i) {
      fan.seen_x_m[i] = fan.x_m[i] - outline.vx_mps * fan.time_s[i];
      fan.seen_y_m[i] = fan.y_m[i] - outline.vy_mps * fan.time_s[i];
    }
    View(fan, fan.seen_x_m.data(), fan.seen_y_m.data(), max_m).draw(outline, shape++);
  }
  for (std::size_t i = 0; i < fan.size(); ++i) {
    if (fan.shape[i] == RayFan::kNoShape) fan.range_m[i] = RayFan::kNothing;
  }
}

RayHit RayCaster::hit(const RayFan& fan, std::size_t ray) const {
  const auto shape = static_cast<std::size_t>(fan.shape[ray]);
  const Outline& o =
      shape < standing_.size() ? standing_[shape] : moving_[shape - standing_.size()];
  const double dx = fan.dx[ray], dy = fan.dy[ray], t = fan.range_m[ray];
  // Where it is met, from the centre.
  const double x = fan.x_m[ray] + t * dx - o.x_m - o.vx_mps * fan.time_s[ray];
  const double y = fan.y_m[ray] + t * dy - o.y_m - o.vy_mps * fan.time_s[ray];
  if (o.is_circle()) {
    return {std::min(std::abs(x * dx + y * dy) / o.half_length_m, 1.0), o.reflectivity};
  }
  const double along_m = std::abs(o.c * x + o.s * y), across_m = std::abs(o.c * y - o.s * x);
  const bool at_end = o.half_length_m - along_m < o.half_width_m - across_m;
  const double cos_incidence = at_end ? o.c * dx + o.s * dy : o.c * dy - o.s * dx;
  return {std::min(std::abs(cos_incidence), 1.0), o.reflectivity};
}

}  // namespace tether
