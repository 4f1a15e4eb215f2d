#include <benchmark/benchmark.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <tether/plan_t.hpp>
#include <tether/twist_t.hpp>
#include <vector>

#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "controller/laws/law.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/nodes/closed_loop.hpp"

// Cost of a decision of each law, and its traffic.

namespace tether {
namespace {

Scenario scenario_of(const std::string& law, std::vector<std::string> more = {}) {
  more.push_back("controller.law=" + law);
  if (law.starts_with("predictive") || law == "mpc") more.emplace_back("actuator.policy=horizon");
  return load_scenario(in_source("/scenarios/paper.toml"), more);
}

/// A decision each 100 ms and a pose with every `poses_each`-th, a vehicle that keeps to the path;
/// plans of 20 s in steps of 50 ms.
void law_step(benchmark::State& state, const std::string& law_name, int poses_each) {
  const Scenario scenario = scenario_of(law_name);
  const std::unique_ptr<Law> law = make_law(scenario);
  const std::shared_ptr<const ReferencePath> path = make_path(scenario.get<PathSettings>());
  SeenPose seen;
  Instant now = kStart;
  std::optional<std::int64_t> plan_id;
  for (auto unused : state) {
    (void)unused;
    if (seen.seq++ % poses_each == 0) {
      const PathPoint at = path->at(to_seconds(now));
      seen.pose = {at.x_m, at.y_m, at.yaw_rad};
      seen.stamp = now;
      seen.arrival = now + std::chrono::milliseconds{50};
      seen.plan_id = plan_id;
      law->on_pose(seen);
    }
    LawOutput output = law->decide(now + std::chrono::milliseconds{50}, &seen);
    if (const auto* plan = std::get_if<Plan>(&output)) plan_id = plan->name.id;
    benchmark::DoNotOptimize(output);
    now += std::chrono::milliseconds{100};
  }
}

/// Bytes per second of both directions on the vehicle's and the controller's air, as LCM encodes
/// them, without headers of LCM, UDP and IP.
void on_the_air(benchmark::State& state, const std::string& law, std::vector<std::string> more) {
  more.emplace_back("run.duration_s=20");
  more.emplace_back("vehicle.plant=kinematic");
  const Scenario scenario = scenario_of(law, more);
  double up = 0.0, down = 0.0, largest = 0.0;
  for (auto unused : state) {
    (void)unused;
    up = down = largest = 0.0;
    ClosedLoop loop(scenario);
    loop.bus().subscribe("AGV/POSE", kDeepQueue,
                         [&](const Message& m) { up += static_cast<double>(m.bytes.size()); });
    loop.bus().subscribe("CTRL/(PLAN|CMD_VEL)", kDeepQueue, [&](const Message& m) {
      down += static_cast<double>(m.bytes.size());
      largest = std::max(largest, static_cast<double>(m.bytes.size()));
    });
    loop.run();
  }
  state.counters["uplink_B_per_s"] = up / scenario.get<RunSettings>().duration_s;
  state.counters["downlink_B_per_s"] = down / scenario.get<RunSettings>().duration_s;
  state.counters["largest_packet_B"] = largest;
}

void add_all() {
  const std::vector<std::string> timer{"controller.trigger=timer", "controller.rate_hz=10"};
  for (const LawKind& law : law_kinds()) {
    if (law.drives_on_request) continue;  // it stands
    benchmark::RegisterBenchmark(("law_step/" + law.name).c_str(), law_step, law.name, 1)
        ->Unit(benchmark::kMicrosecond);
    benchmark::RegisterBenchmark(("on_the_air/" + law.name).c_str(), on_the_air, law.name, timer)
        ->Iterations(1)
        ->Unit(benchmark::kMillisecond);
  }
  std::vector<std::string> one_frame = timer;
  one_frame.emplace_back("controller.plan_step_ms=150");
  benchmark::RegisterBenchmark("on_the_air/plans_of_one_frame", on_the_air,
                               std::string("predictive_consistent"), one_frame)
      ->Iterations(1)
      ->Unit(benchmark::kMillisecond);
  benchmark::RegisterBenchmark("law_step/in_silences_of_20_s", law_step,
                               std::string("predictive_consistent"), 200)
      ->Unit(benchmark::kMicrosecond);
}

[[maybe_unused]] const bool kAdded = (add_all(), true);

}  // namespace
}  // namespace tether
