#pragma once

#include "common/path/curve.hpp"
#include "common/path/reference_path.hpp"
#include "common/vehicle/pose.hpp"

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

/// From `start`, along its heading.
class StraightCurve final : public PathCurve {
 public:
  StraightCurve(const Pose2& start, double length_m) : start_(start), length_m_(length_m) {}

  double length_m() const override { return length_m_; }
  bool is_closed() const override { return false; }
  CurvePoint at(double s_m) const override;

 private:
  Pose2 start_;
  double length_m_;
};

/// A full circle that leaves `start` along its heading and has its centre to the left of it; to the
/// right if clockwise.
class CircleCurve final : public PathCurve {
 public:
  CircleCurve(const Pose2& start, double radius_m, bool clockwise);

  double length_m() const override;
  bool is_closed() const override { return true; }
  CurvePoint at(double s_m) const override;

 private:
  Pose2 start_;
  double curvature_1pm_;
};

/// A turn by 90° to the left from the origin and +x, in which the curvature rises evenly from 0 to
/// 1/radius and falls evenly to 0 again: two clothoids (Fresnel integrals), so that yaw rates do
/// not jump. It ends at (reach, reach), along +y, with reach ≈ 1.87·radius.
class ClothoidCorner {
 public:
  explicit ClothoidCorner(double least_radius_m);

  double length_m() const { return 2.0 * half_length_m_; }
  double reach_m() const { return reach_m_; }
  CurvePoint at(double s_m) const;

 private:
  CurvePoint first_half(double s_m) const;

  double radius_m_;
  double half_length_m_;
  double reach_m_;
};

/// A rectangle with clothoid corners. It begins in the middle of a side of `length_m`, along
/// `start`, and turns left; right if clockwise.
class RoundedRectangleCurve final : public PathCurve {
 public:
  struct Config {
    double length_m = 0.0;  ///< from side to side, along the start's heading
    double width_m = 0.0;   ///< across it
    double corner_radius_m = 0.0;
    bool clockwise = false;
  };

  /// Throws UsageError, naming the keys, if the corners do not fit.
  RoundedRectangleCurve(const Pose2& start, const Config& config);

  double length_m() const override;
  bool is_closed() const override { return true; }
  CurvePoint at(double s_m) const override;

 private:
  CurvePoint quarter(double s_m, double first_m, double second_m) const;

  Pose2 start_;
  Config config_;
  ClothoidCorner corner_;
};

}  // namespace tether
