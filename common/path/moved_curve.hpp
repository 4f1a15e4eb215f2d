#pragma once

#include <memory>
#include <string>
#include <utility>

#include "common/path/curves/curve.hpp"

namespace tether {

/// A curve that begins elsewhere on its lap, and lies elsewhere in the hall.
class MovedCurve final : public PathCurve {
 public:
  /// It begins `begin_m` after the begin of `curve`, in [0, length]; open curves: 0.
  MovedCurve(std::unique_ptr<const PathCurve> curve, double begin_m, double x_m, double y_m)
      : curve_(std::move(curve)), begin_m_(begin_m), x_m_(x_m), y_m_(y_m) {}

  double length_m() const override { return curve_->length_m(); }
  bool is_closed() const override { return curve_->is_closed(); }
  CurvePoint at(double s_m) const override {
    CurvePoint p = curve_->at(there(s_m));
    p.x_m += x_m_;
    p.y_m += y_m_;
    return p;
  }
  double wanted_speed_mps(double s_m) const override {
    return curve_->wanted_speed_mps(there(s_m));
  }
  std::string source(double s_m) const override { return curve_->source(there(s_m)); }

 private:
  double there(double s_m) const {
    const double there_m = s_m + begin_m_;
    return begin_m_ > 0.0 && there_m > length_m() ? there_m - length_m() : there_m;
  }

  std::unique_ptr<const PathCurve> curve_;
  double begin_m_, x_m_, y_m_;
};

}  // namespace tether
