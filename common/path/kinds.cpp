#include "common/path/kinds.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <memory>
#include <string>
#include <utility>

#include "common/base/errors.hpp"
#include "common/path/curve.hpp"

namespace tether {
namespace {

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

}  // namespace

#define TETHER_PATH_KINDS(KIND) \
  KIND(figure_eight)            \
  KIND(circle)                  \
  KIND(line)                    \
  KIND(rounded_rectangle)       \
  KIND(csv)

#define TETHER_DECLARE(name) PathKind name##_path();
TETHER_PATH_KINDS(TETHER_DECLARE)
#undef TETHER_DECLARE

const std::vector<PathKind>& path_kinds() {
#define TETHER_ROW(name) name##_path(),
  static const std::vector<PathKind> kinds{TETHER_PATH_KINDS(TETHER_ROW)};
#undef TETHER_ROW
  return kinds;
}

const PathKind& kind_of(const PathSettings& settings) {
  const auto& kinds = path_kinds();
  const auto found = std::find_if(kinds.begin(), kinds.end(),
                                  [&](const PathKind& kind) { return kind.name == settings.kind; });
  assert(found != kinds.end());
  return *found;
}

std::unique_ptr<const PlannedPath> plan_path(const PathSettings& settings) {
  const PathKind& kind = kind_of(settings);
  if (kind.curve == nullptr) return nullptr;
  std::unique_ptr<const PathCurve> curve = kind.curve(settings);
  if (settings.phase > 0.0 && !curve->is_closed()) {
    throw UsageError(fmt::format(
        "path.phase = {}: this path has no laps, it ends; path.phase must be 0", settings.phase));
  }
  if (settings.is_moved()) {
    const double begin_m = settings.phase * curve->length_m();
    curve = std::make_unique<const MovedCurve>(std::move(curve), begin_m, settings.offset_x_m,
                                               settings.offset_y_m);
  }
  return std::make_unique<const PlannedPath>(std::move(curve), settings.limits);
}

std::shared_ptr<const ReferencePath> make_path(const PathSettings& settings) {
  const PathKind& kind = kind_of(settings);
  if (kind.timed != nullptr) return kind.timed(settings);
  return plan_path(settings);
}

}  // namespace tether
