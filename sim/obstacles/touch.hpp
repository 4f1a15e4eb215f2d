#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "common/path/reference_path.hpp"
#include "common/world/shape.hpp"

namespace tether {

/// How two shapes press on each other, or would if they came nearer.
class Touch {
 public:
  struct Point {
    Position at;         ///< world frame
    double gap_m = 0.0;  ///< there, along the normal
  };

  Touch(const Position& normal, double gap_m) : normal_(normal), gap_m_(gap_m) {}
  void add(const Point& point) { points_[count_++] = point; }

  /// Unit vector from the first shape into the second, world frame.
  const Position& normal() const { return normal_; }
  /// Along the normal; negative: so far one must move to come free.
  double gap_m() const { return gap_m_; }
  /// At least one; two where a side lies on a side.
  std::span<const Point> points() const { return {points_.data(), count_}; }

 private:
  Position normal_;
  double gap_m_;
  std::array<Point, 2> points_{};
  std::size_t count_ = 0;
};

/// How a rectangle touches another shape. The normal is that of the side, of either rectangle, that
/// parts them most, as separating axes have it; of a circle, that through its centre. So a gap is
/// right where a side is nearest, and up to √2 too small between corners. The points are the ends
/// of what the sides have in common (as in Box2D's manifolds: E. Catto, Contact Manifolds, Game
/// Developers Conference 2007).
Touch touch(const Shape& rectangle, const Shape& other);

}  // namespace tether
