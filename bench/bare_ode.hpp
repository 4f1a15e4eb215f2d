#pragma once

#include <benchmark/benchmark.h>

#include <vector>

#include "common/vehicle/vehicle_settings.hpp"
#include "sim/node/sim_node.hpp"
#include "sim/plant/ode_world.hpp"
#include "tools/nodes/closed_loop.hpp"

namespace tether::bench {

/// Setpoints of the servos in a run, step by step.
inline std::vector<WheelSpeeds> record_servo_targets(const Scenario& scenario) {
  std::vector<WheelSpeeds> targets;
  ClosedLoop loop(scenario);
  const Duration step = step_of(scenario.get<WorldSettings>());
  loop.loop().every(kStart + step, step, Priority::observer,
                    [&](Instant) { targets.push_back(loop.sim().vehicle().servo_targets()); });
  loop.run();
  return targets;
}

/// The lower bound for that run: the identical world with the identical targets, and nothing else.
/// `always_limited`: each step is solved with all limits at once.
inline void step_bare_ode(const Scenario& scenario, const std::vector<WheelSpeeds>& targets,
                          bool always_limited = false) {
  OdeWorld world(scenario.get<VehicleSettings>(), scenario.get<WorldSettings>(),
                 to_seconds(step_of(scenario.get<WorldSettings>())));
  world.set_always_limited(always_limited);
  for (const WheelSpeeds& t : targets) world.step(t);
  benchmark::DoNotOptimize(world.rim_speeds());
}

}  // namespace tether::bench
