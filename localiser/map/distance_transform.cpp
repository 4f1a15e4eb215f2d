#include "localiser/map/distance_transform.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <limits>

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

}  // namespace tether
