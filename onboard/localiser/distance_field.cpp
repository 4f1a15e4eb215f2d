#include "onboard/localiser/distance_field.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "common/base/errors.hpp"

namespace tether {
namespace {

constexpr float kInfinite = std::numeric_limits<float>::infinity();

/// The lower envelope of the parabolas f(q) + (x − q)², at each x, in place.
class Envelope {
 public:
  explicit Envelope(std::size_t most) : at_(most), from_(most + 1), f_(most) {}

  void transform(float* values, std::size_t count, std::size_t stride) {
    for (std::size_t i = 0; i < count; ++i) f_[i] = values[i * stride];
    std::size_t parabolas = 0;
    for (std::size_t q = 0; q < count; ++q) {
      if (std::isfinite(f_[q])) parabolas = add(q, parabolas);
    }
    if (parabolas == 0) return;
    std::size_t k = 0;
    for (std::size_t x = 0; x < count; ++x) {
      while (k + 1 < parabolas && from_[k + 1] <= static_cast<double>(x)) ++k;
      const double away = static_cast<double>(x) - static_cast<double>(at_[k]);
      values[x * stride] = static_cast<float>(away * away + f_[at_[k]]);
    }
  }

 private:
  /// How many there are then; those that are nowhere the lowest go.
  std::size_t add(std::size_t q, std::size_t parabolas) {
    const auto height = [this](std::size_t i) {
      return f_[i] + static_cast<double>(i) * static_cast<double>(i);
    };
    double from = -std::numeric_limits<double>::infinity();
    while (parabolas > 0) {
      const std::size_t before = at_[parabolas - 1];
      from = (height(q) - height(before)) / (2.0 * static_cast<double>(q - before));
      if (from > from_[parabolas - 1]) break;
      --parabolas;
      from = -std::numeric_limits<double>::infinity();
    }
    at_[parabolas] = q;
    from_[parabolas] = from;
    return parabolas + 1;
  }

  std::vector<std::size_t> at_;
  std::vector<double> from_;  ///< where a parabola begins to be the lowest
  std::vector<double> f_;
};

}  // namespace

std::vector<float> squared_distances(const std::vector<std::uint8_t>& seeds, int width) {
  assert(width > 0 && seeds.size() % static_cast<std::size_t>(width) == 0);
  const auto columns = static_cast<std::size_t>(width);
  const std::size_t rows = seeds.size() / columns;
  std::vector<float> values(seeds.size());
  for (std::size_t i = 0; i < seeds.size(); ++i) values[i] = seeds[i] != 0 ? 0.0F : kInfinite;
  Envelope envelope(std::max(columns, rows));
  for (std::size_t x = 0; x < columns; ++x) envelope.transform(&values[x], rows, columns);
  for (std::size_t y = 0; y < rows; ++y) envelope.transform(&values[y * columns], columns, 1);
  return values;
}

namespace {

/// Beams that end a little behind an outline are still on the grid.
constexpr double kMargin_m = 1.0;

struct Box {
  double left_m, bottom_m, right_m, top_m;
};

Box box_around(const Shape& shape, double margin_m) {
  double x_m = shape.radius_m, y_m = shape.radius_m;
  if (shape.outline == Shape::Outline::rectangle) {
    const double c = std::abs(std::cos(shape.pose.yaw_rad));
    const double s = std::abs(std::sin(shape.pose.yaw_rad));
    x_m = 0.5 * (c * shape.length_m + s * shape.width_m);
    y_m = 0.5 * (s * shape.length_m + c * shape.width_m);
  }
  return {shape.pose.x_m - x_m - margin_m, shape.pose.y_m - y_m - margin_m,
          shape.pose.x_m + x_m + margin_m, shape.pose.y_m + y_m + margin_m};
}

}  // namespace

DistanceField::DistanceField(const std::vector<Shape>& shapes, double resolution_m) {
  place(shapes, resolution_m);
  for (const Shape& shape : shapes) fill_near(shape);
  fill_far();
  fill_gradients();
}

void DistanceField::place(const std::vector<Shape>& shapes, double resolution_m) {
  assert(!shapes.empty() && resolution_m > 0.0);
  Box all = box_around(shapes.front(), kMargin_m);
  for (const Shape& shape : shapes) {
    const Box box = box_around(shape, kMargin_m);
    all = {std::min(all.left_m, box.left_m), std::min(all.bottom_m, box.bottom_m),
           std::max(all.right_m, box.right_m), std::max(all.top_m, box.top_m)};
  }
  const double columns = std::ceil((all.right_m - all.left_m) / resolution_m) + 1.0;
  const double rows = std::ceil((all.top_m - all.bottom_m) / resolution_m) + 1.0;
  if (columns * rows > static_cast<double>(kMostNodes)) {
    throw UsageError(
        fmt::format("localiser.resolution_m = {}: a map of {:.0f} x {:.0f} m has {:.0f} cells of "
                    "it; at most {}",
                    resolution_m, all.right_m - all.left_m, all.top_m - all.bottom_m,
                    columns * rows, kMostNodes));
  }
  left_m_ = static_cast<float>(all.left_m);
  bottom_m_ = static_cast<float>(all.bottom_m);
  per_m_ = static_cast<float>(1.0 / resolution_m);
  columns_ = static_cast<std::size_t>(columns);
  last_column_ = static_cast<float>(columns - 1.0);
  last_row_ = static_cast<float>(rows - 1.0);
  nodes_.resize(columns_ * static_cast<std::size_t>(rows));
}

void DistanceField::fill_near(const Shape& shape) {
  const Box box = box_around(shape, kExact_m);
  const auto index = [this](double m, float from_m, float last) {
    const double cells = (m - from_m) * per_m_;
    return static_cast<std::size_t>(std::clamp(cells, 0.0, static_cast<double>(last)));
  };
  const std::size_t right = index(box.right_m, left_m_, last_column_);
  const std::size_t top = index(box.top_m, bottom_m_, last_row_);
  for (std::size_t r = index(box.bottom_m, bottom_m_, last_row_); r <= top; ++r) {
    for (std::size_t c = index(box.left_m, left_m_, last_column_); c <= right; ++c) {
      const Position node{left_m_ + static_cast<double>(c) / per_m_,
                          bottom_m_ + static_cast<double>(r) / per_m_};
      const auto here_m = static_cast<float>(distance_m(shape, node));
      float& known_m = nodes_[r * columns_ + c].distance_m;
      if (here_m <= static_cast<float>(kExact_m)) known_m = std::min(known_m, here_m);
    }
  }
}

void DistanceField::fill_far() {
  const float cell_m = 1.0F / per_m_;
  std::vector<std::uint8_t> on_outline(nodes_.size());
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    on_outline[i] = std::abs(nodes_[i].distance_m) <= 0.71F * cell_m ? 1 : 0;
  }
  const std::vector<float> squared = squared_distances(on_outline, static_cast<int>(columns_));
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    if (nodes_[i].distance_m == kFar_m) {
      nodes_[i].distance_m = std::min(kFar_m, cell_m * std::sqrt(squared[i]));
    }
  }
}

void DistanceField::fill_gradients() {
  const auto slope = [this](std::size_t low, std::size_t high, std::size_t steps) {
    return (nodes_[high].distance_m - nodes_[low].distance_m) * per_m_ / static_cast<float>(steps);
  };
  for (std::size_t r = 0; r < rows(); ++r) {
    const std::size_t down = r > 0 ? 1 : 0, up = r + 1 < rows() ? 1 : 0;
    for (std::size_t c = 0; c < columns_; ++c) {
      const std::size_t here = r * columns_ + c;
      const std::size_t back = c > 0 ? 1 : 0, ahead = c + 1 < columns_ ? 1 : 0;
      nodes_[here].by_x = slope(here - back, here + ahead, back + ahead);
      nodes_[here].by_y = slope(here - down * columns_, here + up * columns_, down + up);
    }
  }
}

}  // namespace tether
