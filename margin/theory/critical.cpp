#include "margin/theory/critical.hpp"

#include <cmath>
#include <optional>

namespace tether {

Critical critical_value(const std::function<double(double)>& radius, double low, double high,
                        double tolerance) {
  constexpr int kPoints = 25;
  constexpr double kRounding = 1e-7;
  const auto is_stable = [&](double x) { return radius(x) < 1.0 + kRounding; };
  const bool first = is_stable(low);
  double x = low;
  bool stable = first;
  std::optional<double> below, above;
  for (int i = 1; i < kPoints; ++i) {
    const double next = low + (high - low) * i / (kPoints - 1);
    const bool next_stable = is_stable(next);
    if (next_stable != stable) {
      if (below) return {Critical::Kind::not_monotone, 0.0};
      below = x;
      above = next;
    }
    x = next;
    stable = next_stable;
  }
  if (!below) return {first ? Critical::Kind::always : Critical::Kind::never, 0.0};
  while (*above - *below > tolerance) {
    const double middle = 0.5 * (*below + *above);
    (is_stable(middle) == first ? below : above) = middle;
  }
  return {Critical::Kind::found, 0.5 * (*below + *above)};
}

}  // namespace tether
