#include "tools/view/swept/sweep_runs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <stdexcept>

#include "common/base/text.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/version.hpp"
#include "tools/base/write_file.hpp"
#include "tools/experiment/store/sweeps_below.hpp"
#include "tools/loop/closed_loop.hpp"
#include "tools/runs/output_folder.hpp"
#include "tools/runs/run_observer.hpp"
#include "tools/runs/run_summary.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

/// Between two machines, of the last digits.
bool is_same(double a, double b) { return std::abs(a - b) <= 1e-9 * std::max(1.0, std::abs(b)); }

/// Parses "/runs/4/17": "/runs/4" and 17; nothing if there is no number.
template <class Number>
std::optional<std::pair<std::string_view, Number>> split_number(std::string_view path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string_view::npos) return std::nullopt;
  const auto number = to_number<Number>(path.substr(slash + 1));
  if (!number) return std::nullopt;
  return std::pair{path.substr(0, slash), *number};
}

/// Computes the run and records it; returns its ε.
double record_run(const Scenario& scenario, const fs::path& log,
                  const std::function<void(double share)>& progress) {
  ClosedLoop loop(scenario);
  const RunObserver observer(scenario, loop.loop(), loop.bus());
  EventLogWriter writer(log, loop.loop(), loop.bus());
  const Instant end = kStart + from_seconds(scenario.get<RunSettings>().duration_s);
  for (Instant t = kStart; t < end; t = std::min(end, t + std::chrono::seconds{1})) {
    loop.run_until(t);
    progress(to_seconds(t) / to_seconds(end));
  }
  loop.run();
  check_finite(observer);
  writer.close();
  return observer.truth().epsilon_m;
}

}  // namespace

SweepRuns::SweepRuns(const fs::path& folder) {
  for (const fs::path& database : databases_below(folder)) {
    sweeps_.push_back(read(folder, database));
  }
}

SweepRuns::Sweep SweepRuns::read(const fs::path& folder, const fs::path& database) {
  const RunStore store = RunStore::open(database);
  Sweep sweep{.address = "/" + address_of_runs(folder, database),
              .name = store.name(),
              .version = store.version(),
              .file = database,
              .arms = store.arms(),
              .epsilon_m = {}};
  const std::size_t epsilon = metric_number("epsilon_m").value();
  store.for_each([&](const StoredRun& run) {
    const bool failed = !run.result.failure.empty() || run.arm >= sweep.arms.size();
    sweep.epsilon_m[{run.arm, run.seed}] =
        failed ? std::numeric_limits<double>::quiet_NaN() : run.result.metrics[epsilon];
  });
  return sweep;
}

std::optional<SweepRuns::Found> SweepRuns::find(std::string_view path) const {
  const auto by_seed = split_number<std::uint64_t>(path);
  if (!by_seed) return std::nullopt;
  const auto by_arm = split_number<std::size_t>(by_seed->first);
  if (!by_arm) return std::nullopt;
  const ArmAndSeed run{by_arm->second, by_seed->second};
  for (const Sweep& sweep : sweeps_) {
    if (sweep.address == by_arm->first && sweep.epsilon_m.contains(run)) return Found{&sweep, run};
  }
  return std::nullopt;
}

fs::path SweepRuns::make_again(std::string_view path, const fs::path& into,
                               const std::function<void(double share)>& progress) const {
  const Found found = find(path).value();
  const Sweep& sweep = *found.sweep;
  const auto [arm, seed] = found.run;
  const auto fail = [&, arm = arm, seed = seed](const std::string& why) {
    throw std::runtime_error(fmt::format(
        "arm {}, seed {} of {} cannot be made again: {} (made by tether {}; this is tether {})",
        arm, seed, sweep.file.string(), why, sweep.version, kVersion));
  };
  fs::path log = into / fmt::format("{}-arm{}-seed{}.lcmlog",
                                    fs::path(sweep.name).filename().string(), arm, seed);
  double epsilon_m = 0.0;
  try {
    Scenario scenario =
        with_absolute_names(parse_scenario(sweep.arms.at(arm).scenario, sweep.file.string()));
    scenario.get<RunSettings>().seed = seed;
    write_file(into / "scenario.toml", to_toml(scenario));
    epsilon_m = record_run(scenario, log, progress);
  } catch (const std::exception& error) {
    fail(error.what());
  }
  const double then_m = sweep.epsilon_m.at(found.run);
  if (!is_same(epsilon_m, then_m)) {
    fail(fmt::format("its ε comes to {} m, where the sweep has {} m", epsilon_m, then_m));
  }
  return log;
}

}  // namespace tether
