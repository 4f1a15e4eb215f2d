#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <stdexcept>
#include <string>
#include <tether/drivetrain_state_t.hpp>
#include <tether/twist_t.hpp>
#include <vector>

#include "bench/smoke.hpp"
#include "bench/timed_world.hpp"
#include "bench/timing.hpp"
#include "can_bridge/bus/in_process_can.hpp"
#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/node/can_bridge_node.hpp"
#include "can_bridge/node/can_drive_node.hpp"
#include "common/node/in_process_bus.hpp"
#include "common/node/message_io.hpp"
#include "common/node/virtual_loop.hpp"
#include "common/scenario/run_settings.hpp"
#include "sim/node/sim_node.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/can/arm_operator.hpp"
#include "tools/nodes/can_loop.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/runs/run_observer.hpp"

// Cost of the CAN drivetrain in one process and virtual time: a whole run against the same run
// without CAN, and its parts by themselves.

namespace tether {
namespace {

using bench::median;

Scenario hil(const std::vector<std::string>& overrides) {
  return load_scenario(in_source("/scenarios/hil_vcan.toml"), overrides);
}

double seconds_of_run(const Scenario& scenario) {
  return bench::seconds_of([&] {
    ClosedLoop loop(scenario);
    const RunObserver observer(scenario, loop.loop(), loop.bus());
    loop.run();
    benchmark::DoNotOptimize(loop.sim().metrics().epsilon_m());
  });
}

/// Timed in turn, A B A B …, so that the ratio holds while the machine's speed drifts.
void whole_run_over_can(benchmark::State& state) {
  const Scenario with_can = hil({});
  const Scenario direct = hil({"vehicle.drivetrain=direct"});
  std::vector<double> can_s, direct_s, ratio;
  for (auto unused : state) {
    (void)unused;
    direct_s.push_back(seconds_of_run(direct));
    can_s.push_back(seconds_of_run(with_can));
    ratio.push_back(can_s.back() / direct_s.back());
    state.SetIterationTime(can_s.back());
  }
  state.counters["direct_ms"] = median(direct_s) * 1e3;
  state.counters["can_over_direct"] = median(ratio);
  state.counters["real_time_factor"] =
      (with_can.get<RunSettings>().lead_s + with_can.get<RunSettings>().duration_s) / median(can_s);
}
BENCHMARK(whole_run_over_can)
    ->UseManualTime()
    ->Iterations(bench::rounds(15))
    ->Unit(benchmark::kMillisecond);

/// Bridge, bus and emulated drives with wheels of their own, armed, driving a curve.
class Drivetrain {
  using Stopwatch = bench::Stopwatch;

 public:
  Drivetrain() {
    subscribe<drivetrain_state_t>(bus_, "CAN/STATE", 1, undecodable_,
                                  [this](const drivetrain_state_t& m) { state_ = m; });
    loop_.every(loop_.now(), kCommandPeriod, Priority::node, [this](Instant now) { steer(now); });
    loop_.run_until(kStart + std::chrono::seconds{5});
    check_armed();
  }
  Drivetrain(const Drivetrain&) = delete;
  Drivetrain& operator=(const Drivetrain&) = delete;

  void run_for(Duration time) { loop_.run_until(loop_.now() + time); }
  Duration cycle_time() const { return cycle_time_; }
  void check_armed() const {
    if (state_.state == drivetrain_state_t::ARMED) return;
    throw std::runtime_error("the drivetrain is " + state_.state_name + ": " + state_.reason);
  }

  Stopwatch cycle, frame_to_bridge, tick, frame_to_drives;

 private:
  static constexpr Duration kCommandPeriod = std::chrono::milliseconds{50};

  void steer(Instant now) {
    twist_t command{};
    command.utime = to_utime(now);
    command.pose_utime = -1;
    command.seq = commands_++;
    command.v_mps = now < kStart ? 0.0 : 1.0;
    command.omega_radps = now < kStart ? 0.0 : 0.3;
    publish(bus_, "AGV/CMD_VEL", command);
  }

  Scenario scenario_ = hil({"can.wheels=model"});
  DrivetrainConfig config_ = load_drivetrain(scenario_.get<CanSettings>().drivetrain_file);
  Duration cycle_time_ = from_seconds(scenario_.get<CanSettings>().cycle_ms * 1e-3);
  VirtualLoop loop_{kStart - from_seconds(scenario_.get<RunSettings>().lead_s)};
  InProcessBus bus_{loop_};
  InProcessCan can_{loop_, scenario_.get<CanSettings>().bit_rate_bps};
  bench::TimedLoop drive_loop_{loop_, CanDriveNode::kTick, tick};
  bench::TimedLoop bridge_loop_{loop_, cycle_time_, cycle};
  bench::TimedPort drive_port_{can_.add_port(), frame_to_drives};
  bench::TimedPort bridge_port_{can_.add_port(), frame_to_bridge};
  CanDriveNode drives_{scenario_, config_, drive_loop_, bus_, drive_port_};
  CanBridgeNode bridge_{scenario_, config_, bridge_loop_, bus_, bridge_port_};
  ArmOperator operator_{scenario_, loop_, bus_};
  drivetrain_state_t state_{};
  std::int64_t commands_ = 0;
  std::int64_t undecodable_ = 0;
};

/// The mean cost in microseconds of what `watch` timed since `before`.
double mean_us(const bench::Stopwatch& watch, const bench::Stopwatch& before) {
  return (watch.seconds() - before.seconds()) * 1e6 /
         static_cast<double>(watch.calls() - before.calls());
}

/// Decide, limit, encode and send frames, publish three messages; and apart from that, each frame
/// that comes in.
void one_bridge_cycle(benchmark::State& state) {
  Drivetrain drivetrain;
  const bench::Stopwatch frames_before = drivetrain.frame_to_bridge;
  const std::int64_t cycles_before = drivetrain.cycle.calls();
  for (auto unused : state) {
    (void)unused;
    const double before_s = drivetrain.cycle.seconds();
    drivetrain.run_for(drivetrain.cycle_time());
    state.SetIterationTime(drivetrain.cycle.seconds() - before_s);
  }
  drivetrain.check_armed();
  const bench::Stopwatch& frames = drivetrain.frame_to_bridge;
  state.counters["frame_us"] = mean_us(frames, frames_before);
  state.counters["frames_per_cycle"] =
      static_cast<double>(frames.calls() - frames_before.calls()) /
      static_cast<double>(drivetrain.cycle.calls() - cycles_before);
}
BENCHMARK(one_bridge_cycle)->UseManualTime()->Iterations(20'000)->Unit(benchmark::kMicrosecond);

/// One millisecond of both emulated drives and their wheels; and apart from that, each frame that
/// comes in, answers included.
void one_emulator_tick(benchmark::State& state) {
  Drivetrain drivetrain;
  const bench::Stopwatch frames_before = drivetrain.frame_to_drives;
  for (auto unused : state) {
    (void)unused;
    const double before_s = drivetrain.tick.seconds();
    drivetrain.run_for(CanDriveNode::kTick);
    state.SetIterationTime(drivetrain.tick.seconds() - before_s);
  }
  drivetrain.check_armed();
  state.counters["frame_us"] = mean_us(drivetrain.frame_to_drives, frames_before);
}
BENCHMARK(one_emulator_tick)->UseManualTime()->Iterations(200'000)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace tether
