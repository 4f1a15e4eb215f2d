#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

#include "bench/can_tap.hpp"
#include "bench/cpu_time.hpp"
#include "bench/live_drivetrain.hpp"
#include "bench/run.hpp"
#include "bench/samples.hpp"
#include "bench/smoke.hpp"

// Latencies and loads of the CAN bridge as a process, on a real (virtual) CAN interface and a real
// LCM network, with a bare SocketCAN echo in the same run. Needs vcan0 and vcan1 and runs through
// tests/uml/with_can.sh. It reports, and fails only if the bridge cannot be armed or nothing is
// measured.
//
// Both latencies contain a wait for the bridge's next control cycle: frames and reports leave
// nowhere else.

namespace tether {
namespace {

using bench::CanTap;
using bench::LiveDrivetrain;
using bench::Samples;
using bench::wall_ns;
using std::chrono::milliseconds;
using std::chrono::seconds;

// Control cycles.
constexpr std::int64_t kUsual_ms = 20;
constexpr std::int64_t kShort_ms = 10;

/// For all samples of one latency.
constexpr std::int64_t kPatience_ns = 15'000'000'000;

std::unique_ptr<LiveDrivetrain> running;
std::int64_t running_ms = 0;

void end_processes() {
  if (!running) return;
  running->end();
  for (const auto& [reason, count] : running->stops()) {
    fmt::print(stderr, "cycle {} ms: stopped {} x: {}\n", running_ms, count, reason);
  }
  running.reset();
}

/// The processes at this control cycle; those at another one are ended.
LiveDrivetrain& drivetrain(std::int64_t cycle_ms) {
  if (running_ms != cycle_ms) end_processes();
  if (!running) {
    running = std::make_unique<LiveDrivetrain>(static_cast<double>(cycle_ms));
    running_ms = cycle_ms;
  }
  running->ensure_armed();
  return *running;
}

/// Takes the wanted number of samples, or as many as the time allows.
template <class Measure>
void latency(benchmark::State& state, int wanted, const Measure& measure) {
  LiveDrivetrain& live = drivetrain(state.range(0));
  for (auto unused : state) {
    (void)unused;
    Samples samples;
    const std::int64_t deadline_ns = wall_ns() + kPatience_ns;
    while (samples.size() < static_cast<std::size_t>(wanted) && wall_ns() < deadline_ns)
      samples.add(measure(live));
    samples.report(state);
  }
}

void command_in_frame_out(benchmark::State& state) {
  latency(state, bench::rounds(120),
          [](LiveDrivetrain& live) { return live.command_to_frame_ns(); });
}

void frame_in_report_out(benchmark::State& state) {
  latency(state, bench::rounds(300),
          [](LiveDrivetrain& live) { return live.frame_to_report_ns(); });
}

/// Frames and bits of 5 s. Commands and reports flow as ever.
void bus_traffic(benchmark::State& state) {
  LiveDrivetrain& live = drivetrain(state.range(0));
  for (auto unused : state) {
    (void)unused;
    const LiveDrivetrain::Traffic traffic = live.drive_for(bench::window(seconds{5}));
    if (traffic.frames == 0) throw std::runtime_error("no frames on the bus");
    state.SetIterationTime(traffic.elapsed_s);
    state.counters["frames_per_s"] = static_cast<double>(traffic.frames) / traffic.elapsed_s;
    state.counters["bus_load_percent"] =
        100.0 * static_cast<double>(traffic.bits) / traffic.elapsed_s / live.bit_rate_bps();
  }
}

/// CPU time of 10 s, in percent of one CPU. The figure for a kernel without CAN: can_cpu_bench.
void cpu_load(benchmark::State& state) {
  LiveDrivetrain& live = drivetrain(state.range(0));
  if (bench::charges_whole_ticks()) state.SetLabel("this kernel charges whole ticks: no figure");
  for (auto unused : state) {
    (void)unused;
    const std::array<double, 2> before{bench::cpu_seconds(live.bridge_pid()),
                                       bench::cpu_seconds(live.drive_pid())};
    const std::int64_t start_ns = wall_ns();
    live.drive_for(bench::window(seconds{10}));
    const double elapsed_s = static_cast<double>(wall_ns() - start_ns) * 1e-9;
    const auto percent = [&](double used_s) { return 100.0 * used_s / elapsed_s; };
    state.SetIterationTime(elapsed_s);
    state.counters["bridge_percent"] = percent(bench::cpu_seconds(live.bridge_pid()) - before[0]);
    state.counters["drives_percent"] = percent(bench::cpu_seconds(live.drive_pid()) - before[1]);
  }
}

/// The lower bound: two raw sockets, each in a thread of its own. Half of the time that a frame
/// takes there and back, while bridge and drives work on the other interface.
void bare_echo(benchmark::State& state) {
  drivetrain(state.range(0));
  const CanTap here("vcan1");
  const CanTap there("vcan1");
  std::atomic<bool> done{false};
  std::thread echo([&] {
    while (!done) {
      if (const auto frame = there.receive(100)) there.send(frame->frame);
    }
  });
  for (auto unused : state) {
    (void)unused;
    Samples samples;
    for (int i = 0; i < 500; ++i) {
      std::this_thread::sleep_for(milliseconds{2});
      const auto number = static_cast<std::uint8_t>(i);
      const CanFrame frame = CanFrame::make(0x123, {number, 0, 0, 0, 0, 0});
      const std::int64_t sent_ns = wall_ns();
      here.send(frame);
      const auto answer = here.receive(1000);
      const std::int64_t returned_ns = wall_ns();
      if (answer && answer->frame == frame) samples.add((returned_ns - sent_ns) / 2);
    }
    samples.report(state);
  }
  done = true;
  echo.join();
}

#define TETHER_LIVE_BENCH(function, cycle_ms) \
  BENCHMARK(function)                         \
      ->ArgName("cycle_ms")                   \
      ->Arg(cycle_ms)                         \
      ->Iterations(1)                         \
      ->UseManualTime()                       \
      ->Unit(benchmark::kMillisecond)
// In this order: the processes are restarted for another cycle.
TETHER_LIVE_BENCH(command_in_frame_out, kUsual_ms);
TETHER_LIVE_BENCH(frame_in_report_out, kUsual_ms);
TETHER_LIVE_BENCH(bus_traffic, kUsual_ms);
TETHER_LIVE_BENCH(bare_echo, kUsual_ms);
TETHER_LIVE_BENCH(command_in_frame_out, kShort_ms);
TETHER_LIVE_BENCH(frame_in_report_out, kShort_ms);
TETHER_LIVE_BENCH(bus_traffic, kShort_ms);
TETHER_LIVE_BENCH(cpu_load, kShort_ms);
#undef TETHER_LIVE_BENCH

}  // namespace
}  // namespace tether

int main(int argc, char** argv) {
  return tether::bench::run_benchmarks(argc, argv, [] { tether::end_processes(); });
}
