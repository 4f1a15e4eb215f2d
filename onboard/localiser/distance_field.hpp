#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/world/shape.hpp"

namespace tether {

/// For each cell of a grid, row by row, the squared distance of its centre to that of the nearest
/// seed, in cells; infinite if there is no seed. Exact, in a time proportional to the cells:
/// Felzenszwalb & Huttenlocher, Distance Transforms of Sampled Functions. Theory of Computing 8
/// (2012), 415–428.
std::vector<float> squared_distances(const std::vector<std::uint8_t>& seeds, int width);

/// How far each place is from the outlines of a map's shapes, which is what a scanner sees of them:
/// negative inside. Kept at the nodes of a grid, bilinear in between.
///
/// At nodes within kExact_m of a shape and inside of shapes the distance is the shape's own, not
/// one to cells: so straight outlines are where they are, in any direction, and not in steps of the
/// grid. What is thinner than two cells, or narrower than that where shapes touch, is not exact.
/// Farther away it is the exact transform of the cells on the outlines, off by less than a cell.
class DistanceField {
 public:
  static constexpr double kExact_m = 1.0;
  static constexpr float kFar_m = 1e3F;  ///< beyond the grid
  /// More nodes than this are refused.
  static constexpr std::size_t kMostNodes = 20'000'000;

  struct Value {
    float distance_m = kFar_m;
    // How it grows along x and y: of length 1, but where two outlines are equally far.
    float by_x = 0.0F;
    float by_y = 0.0F;
  };

  /// Throws UsageError, naming localiser.resolution_m, if that takes more than kMostNodes.
  /// `shapes`: at least one.
  DistanceField(const std::vector<Shape>& shapes, double resolution_m);

  Value at(float x_m, float y_m) const {
    const float column = (x_m - left_m_) * per_m_;
    const float row = (y_m - bottom_m_) * per_m_;
    // False for NaN, too.
    if (!(column >= 0.0F && row >= 0.0F && column < last_column_ && row < last_row_)) return {};
    const auto c = static_cast<int>(column);
    const auto r = static_cast<int>(row);
    const float s = column - static_cast<float>(c), t = row - static_cast<float>(r);
    const Value* low =
        &nodes_[static_cast<std::size_t>(r) * columns_ + static_cast<std::size_t>(c)];
    const Value* high = low + columns_;
    const float a = (1.0F - s) * (1.0F - t), b = s * (1.0F - t), d = (1.0F - s) * t, e = s * t;
    return {a * low[0].distance_m + b * low[1].distance_m + d * high[0].distance_m +
                e * high[1].distance_m,
            a * low[0].by_x + b * low[1].by_x + d * high[0].by_x + e * high[1].by_x,
            a * low[0].by_y + b * low[1].by_y + d * high[0].by_y + e * high[1].by_y};
  }

  // The grid's extent.
  double left_m() const { return left_m_; }
  double bottom_m() const { return bottom_m_; }
  double width_m() const { return last_column_ / per_m_; }
  double height_m() const { return last_row_ / per_m_; }

 private:
  void place(const std::vector<Shape>& shapes, double resolution_m);
  void fill_near(const Shape& shape);
  void fill_far();
  void fill_gradients();
  std::size_t rows() const { return nodes_.size() / columns_; }

  float left_m_ = 0.0F, bottom_m_ = 0.0F;
  float per_m_ = 1.0F;                          ///< cells
  float last_column_ = 0.0F, last_row_ = 0.0F;  ///< numbers of the last nodes
  std::size_t columns_ = 0;                     ///< number of nodes
  std::vector<Value> nodes_;
};

}  // namespace tether
