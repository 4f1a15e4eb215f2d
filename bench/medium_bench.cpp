#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <vector>

#include "netem/medium/contention.hpp"
#include "netem/medium/scheduled_cell.hpp"
#include "netem/medium/wifi_airtime.hpp"

// Cost of a transmission on a shared medium, in virtual time.

namespace tether {
namespace {

/// Stations that always have a frame: every transmission looks at all of them.
void saturated_transmission(benchmark::State& state) {
  Contention medium({.slot = std::chrono::microseconds{9}, .sifs = std::chrono::microseconds{16}},
                    1, [](const FrameEnd&) {});
  for (int i = 0; i < state.range(0); ++i) {
    medium.saturate(kStart, medium.add(i, {}, {}, fmt::format("station {}", i)),
                    unicast_frame({}, 120, true));
  }
  for (auto _ : state) medium.advance(medium.next_event());
  state.SetItemsProcessed(medium.counters().transmissions);
}
BENCHMARK(saturated_transmission)->Arg(5)->Arg(20)->Arg(100);

/// The floor: the random number that every transmission needs.
void one_draw(benchmark::State& state) {
  RandomEngine random(1);
  for (auto _ : state) benchmark::DoNotOptimize(uniform_01(random));
}
BENCHMARK(one_draw);

/// Vehicles with a pose up and a command down, 20 times a second each, and the access point.
void periodic_frame(benchmark::State& state) {
  const auto vehicles = static_cast<std::size_t>(state.range(0));
  Contention medium({.slot = std::chrono::microseconds{9}, .sifs = std::chrono::microseconds{16}},
                    1, [](const FrameEnd&) {});
  for (std::size_t i = 0; i <= vehicles; ++i) {
    medium.add(static_cast<int>(i), {}, {}, fmt::format("station {}", i));
  }
  const Frame frame = unicast_frame({}, 160, true);
  const Duration between = Duration{std::chrono::milliseconds{50}} / (2 * vehicles);
  Instant now = kStart;
  std::size_t next = 0;
  for (auto _ : state) {
    now += between;
    medium.push(now, next % 2 == 0 ? vehicles : next / 2, frame);
    next = (next + 1) % (2 * vehicles);
  }
  state.SetItemsProcessed(state.iterations());
  state.counters["x_real_time"] = benchmark::Counter(to_seconds(now), benchmark::Counter::kIsRate);
}
BENCHMARK(periodic_frame)->Arg(1)->Arg(20)->Arg(100);

void scheduled_packet(benchmark::State& state) {
  const auto vehicles = static_cast<std::size_t>(state.range(0));
  ScheduledCell cell({}, 1, [](const PacketEnd&) {});
  for (std::size_t i = 0; i < vehicles; ++i) cell.add(fmt::format("AGV{}", i));
  const Duration between = Duration{std::chrono::milliseconds{50}} / vehicles;
  Instant now = kStart;
  std::uint64_t id = 0;
  for (auto _ : state) {
    now += between;
    cell.push(now, id % vehicles, id, 160);
    ++id;
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(scheduled_packet)->Arg(1)->Arg(100);

}  // namespace
}  // namespace tether
