#pragma once

#include "common/path/reference_path.hpp"

namespace tether {

/// The paper's reference path: x = A sin θ, y = A sin θ cos θ with θ = rate·t, turned by
/// `rotation_rad`. With −45° it starts at the origin parallel to +x, and is run through in
/// 2π/rate seconds (62.8 s with the defaults; A = 20 m reaches ±18.4 m).
class FigureEight final : public ReferencePath {
 public:
  struct Config {
    double amplitude_m = 20.0;
    double rate_radps = 0.1;
    double rotation_rad = -0.78539816339744831;  ///< −π/4
    double phase = 0.0;                          ///< share of an eight at t = 0
    double x_m = 0.0;                            ///< position of its crossing
    double y_m = 0.0;
  };

  explicit FigureEight(const Config& config);

  PathPoint at(double t_s) const override;
  Position position_at(double t_s) const override;

 private:
  double amplitude_m_;
  double rate_radps_;
  double theta_rad_;  ///< at t = 0
  double x_m_, y_m_;
  double cos_;
  double sin_;
};

}  // namespace tether
