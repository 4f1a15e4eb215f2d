#pragma once

#include <cmath>

namespace tether {

// Near its path, and from step to step, the angles of a vehicle are small: their series are shorter
// than what libm does for all angles. Up to their bounds these are within 2 units of the last
// place, beyond they are libm's. Terms are in pairs (Estrin's scheme), because one plan waits for
// hundreds of them in a row.

struct SinCos {
  double sin, cos;
};

inline SinCos sin_cos(double x_rad) {
  constexpr double kSmall = 0.1;  // the next terms are below x¹⁰/10!, 3e-17
  if (!(std::abs(x_rad) < kSmall)) return {std::sin(x_rad), std::cos(x_rad)};
  const double x2 = x_rad * x_rad, x4 = x2 * x2;
  return {x_rad + x_rad * x2 *
                      ((-1.0 / 6 + x2 * (1.0 / 120)) + x4 * (-1.0 / 5040 + x2 * (1.0 / 362880))),
          1.0 + x2 * ((-1.0 / 2 + x2 * (1.0 / 24)) + x4 * (-1.0 / 720 + x2 * (1.0 / 40320)))};
}

/// The direction of (x, y), as std::atan2.
inline double direction_of(double y, double x) {
  constexpr double kSmall = 0.04;  // the next term is below z¹²/13, 1e-18
  if (!(std::abs(y) < kSmall * x)) return std::atan2(y, x);
  const double z = y / x, z2 = z * z, z4 = z2 * z2;
  return z +
         z * z2 *
             ((-1.0 / 3 + z2 * (1.0 / 5)) + z4 * ((-1.0 / 7 + z2 * (1.0 / 9)) - z4 * (1.0 / 11)));
}

/// A direction that is turned by small angles, again and again: each turn adds an error of 1e-16.
struct Heading {
  double cos = 1.0, sin = 0.0;

  static Heading of(double yaw_rad) { return {std::cos(yaw_rad), std::sin(yaw_rad)}; }
  Heading turned(const SinCos& by) const {
    return {cos * by.cos - sin * by.sin, sin * by.cos + cos * by.sin};
  }
};

}  // namespace tether
