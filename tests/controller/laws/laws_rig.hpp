#pragma once

#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/vehicle/motion_model.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/laws/law.hpp"

namespace tether::test {

/// A law and the vehicle that it believes in, without messages: laws are pure.
struct LawRig {
  Scenario scenario;
  std::shared_ptr<const ReferencePath> path = make_path(scenario.get<PathSettings>());
  std::unique_ptr<Law> law;
  MotionModel model{{}};
  MotionModel::State vehicle;

  explicit LawRig(const Scenario& s) : scenario(s), law(make_law(s)) {}

  /// The vehicle as a pose that took `delay` to get here.
  SeenPose seen(Instant stamp, Duration delay = Duration{0},
                std::optional<std::int64_t> plan_id = std::nullopt) const {
    SeenPose s;
    s.pose = vehicle.pose;
    s.stamp = stamp;
    s.arrival = stamp + delay;
    s.seq = to_utime(stamp);
    s.plan_id = plan_id;
    return s;
  }
  /// Moves the vehicle in steps of 1 ms along what `twist_at` says.
  template <class Function>
  void drive(Instant from, Instant to, Function twist_at) {
    for (Instant t = from; t < to; t += std::chrono::milliseconds{1}) {
      model.advance(vehicle, twist_at(t), 1e-3);
    }
  }
  double error_m(Instant t) const {
    const PathPoint p = path->at(to_seconds(t));
    return std::hypot(p.x_m - vehicle.pose.x_m, p.y_m - vehicle.pose.y_m);
  }
};

inline Scenario with_law(const std::string& law) {
  Scenario s;
  s.get<ControllerSettings>().law = law;
  return s;
}

}  // namespace tether::test
