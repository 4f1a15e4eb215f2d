#include <benchmark/benchmark.h>

#include <chrono>
#include <functional>
#include <sstream>
#include <string>

#include "bench/smoke.hpp"
#include "bench/timing.hpp"
#include "common/scenario/scenario.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/log/log_survey.hpp"
#include "tools/log/mcap_export.hpp"
#include "tools/log/scene_setting.hpp"
#include "tools/messages/event_log.hpp"
#include "tools/messages/message_printer.hpp"
#include "tools/nodes/closed_loop.hpp"

// Export of a run's log, in memory, against two floors: copying the log's bytes, and decoding its
// messages without writing anything. In turn; medians of CPU time, for all is one thread.

namespace tether {
namespace {

using bench::cpu_seconds_of;
using bench::median;

Scenario scenario() {
  return load_scenario(
      in_source("/scenarios/paper.toml"),
      {"vehicle.plant=kinematic", "sensor.rate_hz=20", "sensor.odometry_rate_hz=20",
       bench::is_smoke() ? "run.duration_s=5" : "run.duration_s=600"});
}

std::string big_endian(std::uint64_t value, int size) {
  std::string bytes;
  for (int i = size - 1; i >= 0; --i) bytes += static_cast<char>(value >> (8 * i));
  return bytes;
}

/// The log that `tether run` would record.
std::string record(const Scenario& scenario) {
  std::string log;
  ClosedLoop loop(scenario);
  loop.bus().subscribe(".*", 1000, [&](const Message& message) {
    log += big_endian(EventLogReader::kMagic, 4) + big_endian(0, 8);
    log += big_endian(static_cast<std::uint64_t>(to_utime(loop.loop().now())), 8);
    log += big_endian(message.channel.size(), 4) + big_endian(message.bytes.size(), 4);
    log += message.channel;
    log.append(reinterpret_cast<const char*>(message.bytes.data()), message.bytes.size());
  });
  loop.run();
  return log;
}

void copy(const std::string& log) {
  std::istringstream in(log);
  std::string out, piece(1 << 16, '\0');
  while (in.read(piece.data(), static_cast<std::streamsize>(piece.size())), in.gcount() > 0) {
    out.append(piece, 0, static_cast<std::size_t>(in.gcount()));
  }
  benchmark::DoNotOptimize(out.data());
}

void decode_all(const std::string& log) {
  std::istringstream in(log);
  EventLogReader reader(in);
  LoggedEvent event;
  while (reader.next(event)) benchmark::DoNotOptimize(inspect_message(event.data).values.data());
}

/// Converts like `tether log mcap`, with its survey.
std::size_t convert(const std::string& log, const McapExport& how) {
  std::istringstream first(log), second(log);
  EventLogReader surveyed(first), exported(second);
  const LogSurvey survey = survey_log(surveyed);
  std::string out;
  export_mcap(exported, survey, how, [&](std::string_view bytes) { out += bytes; });
  return out.size();
}

void export_log(benchmark::State& state, bool ros2) {
  const std::string log = record(scenario());
  const McapExport how{ros2, scene_setting(scenario()), "bench"};
  std::size_t bytes = 0;
  std::vector<double> copying_s, decoding_s, exporting_s;
  for (auto _ : state) {
    for (int round = 0; round < bench::rounds(11); ++round) {
      copying_s.push_back(cpu_seconds_of([&] { copy(log); }));
      decoding_s.push_back(cpu_seconds_of([&] { decode_all(log); }));
      exporting_s.push_back(cpu_seconds_of([&] { bytes = convert(log, how); }));
    }
  }
  const double mb = static_cast<double>(log.size()) / 1e6;
  state.counters["log_MB"] = mb;
  state.counters["MB_per_s"] = mb / median(exporting_s);
  state.counters["over_copying"] = median(exporting_s) / median(copying_s);
  state.counters["over_decoding"] = median(exporting_s) / median(decoding_s);
  state.counters["mcap_over_log_bytes"] =
      static_cast<double>(bytes) / static_cast<double>(log.size());
}
BENCHMARK_CAPTURE(export_log, json, false)->Unit(benchmark::kMillisecond)->Iterations(1);
BENCHMARK_CAPTURE(export_log, ros2, true)->Unit(benchmark::kMillisecond)->Iterations(1);

}  // namespace
}  // namespace tether
