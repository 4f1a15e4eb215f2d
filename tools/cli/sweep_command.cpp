#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/errors.hpp"
#include "common/program/cli.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/version.hpp"
#include "tools/base/table.hpp"
#include "tools/base/text_output.hpp"
#include "tools/cli/commands.hpp"
#include "tools/experiment/report/report.hpp"
#include "tools/experiment/sweep/data.hpp"
#include "tools/experiment/sweep/experiment.hpp"
#include "tools/experiment/sweep/export.hpp"
#include "tools/experiment/sweep/lock.hpp"
#include "tools/experiment/sweep/never_commanded.hpp"
#include "tools/experiment/sweep/progress.hpp"
#include "tools/experiment/sweep/run_once.hpp"
#include "tools/experiment/sweep/session.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

struct SweepCommandOptions {
  std::string experiment_file;
  std::vector<std::string> overrides;
  std::optional<std::size_t> jobs;
  std::string out;
  std::string shard = "1/1";
  bool dry_run = false;
  bool quick = false;
  bool report = false;
};

/// How long a run takes, from up to three arms.
double seconds_per_run(const Experiment& experiment) {
  const std::size_t last = experiment.arms.size() - 1;
  std::vector<std::size_t> arms{0, last / 2, last};
  arms.erase(std::unique(arms.begin(), arms.end()), arms.end());
  const auto start = std::chrono::steady_clock::now();
  for (const std::size_t arm : arms) {
    Scenario scenario = experiment.arms[arm].scenario;
    scenario.get<RunSettings>().seed = experiment.seed(arm, 0);
    const RunResult result = run_once(scenario, experiment.trajectory_period_s);
    if (result.failure.empty()) continue;
    fmt::print(stderr, "{}, seed {} fails: {}\n", experiment.arms[arm].text(),
               scenario.get<RunSettings>().seed, result.failure);
  }
  const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
  return taken.count() / static_cast<double>(arms.size());
}

int say_plan(const Experiment& experiment, const Shard& shard, std::size_t jobs) {
  const double run_s = seconds_per_run(experiment);
  const std::size_t most = experiment.arms.size() * experiment.seeds.size();
  const std::size_t least =
      experiment.precision ? experiment.arms.size() * experiment.precision->batch : most;
  const auto duration = [&](std::size_t runs) {
    const std::size_t here = (runs + shard.count - 1) / shard.count;
    return format_duration(run_s * static_cast<double>(here) / static_cast<double>(jobs));
  };
  const auto counted = [](std::size_t n, const char* one) {
    return fmt::format("{} {}{}", n, one, n == 1 ? "" : "s");
  };
  const std::string what = counted(experiment.arms.size(), "combination");
  if (least == most) {
    fmt::print("{} of {}: {}, about {} on {} ({:.3f} s a run)\n", what,
               counted(experiment.seeds.size(), "seed"), counted(most, "run"), duration(most),
               counted(jobs, "core"), run_s);
  } else {
    fmt::print("{} of {} to {} seeds: {} to {} runs, about {} to {} on {} ({:.3f} s a run)\n", what,
               experiment.precision->batch, experiment.seeds.size(), least, most, duration(least),
               duration(most), counted(jobs, "core"), run_s);
  }
  if (shard.count > 1) fmt::print("of these, shard {} makes one in {}\n", shard.index, shard.count);
  return kExitOk;
}

/// One row for each arm, as far as a screen has room.
void print_arms(const fs::path& database) {
  constexpr std::size_t kMostRows = 30;
  const RunStore store = RunStore::open(database);
  const SweepData errors(store, "epsilon_m"), walls(store, "wall_contact_s");
  std::vector<std::vector<std::string>> rows{
      {"setting", "ε [m], mean and 95 % interval", "lost", "at the walls [s]"}};
  const auto& arms = errors.arms();
  for (std::size_t i = 0; i < std::min(arms.size(), kMostRows); ++i) {
    const Summary& walls_s = walls.arms()[i].summary;
    rows.push_back({settings_text(arms[i].settings), mean_text(arms[i].summary),
                    share_text(arms[i].survival.lost),
                    walls_s.n == 0 ? "-" : fmt::format("{:.1f}", walls_s.mean)});
  }
  print_table(rows);
  if (arms.size() > kMostRows) {
    fmt::print("{} more: tether sweep export {} --means\n", arms.size() - kMostRows,
               database.parent_path().string());
  }
}

int sweep(const SweepCommandOptions& options) {
  if (options.experiment_file.empty()) {
    throw UsageError("sweep: name an experiment file (see --help)");
  }
  const Experiment experiment =
      load_experiment(options.experiment_file, options.overrides, options.quick);
  const Shard shard = shard_of(options.shard);
  const std::size_t jobs = options.jobs.value_or(default_jobs());
  if (options.dry_run) return say_plan(experiment, shard, jobs);

  if (options.report && shard.count > 1) {
    throw UsageError("--report needs all runs: merge the shards, then `tether report`");
  }
  const std::string name = experiment.name + (options.quick ? "-quick" : "");
  const fs::path folder = options.out.empty() ? fs::path("out") / name : fs::path(options.out);
  const SweepOutcome outcome = sweep_into(folder, experiment, shard, jobs);
  fmt::print("{} runs with plant {} in {}{}\n", outcome.runs, outcome.plant,
             outcome.database.string(),
             outcome.failed == 0
                 ? ""
                 : fmt::format(", of which {} failed (see `tether sweep export`)", outcome.failed));
  if (outcome.failed > 0) fmt::print("failed    {}\n", outcome.first_failure);
  if (outcome.is_complete && shard.count == 1) print_arms(outcome.database);
  if (outcome.is_complete && options.report) {
    write_report(folder, RiskDefinition::whole_run);
    fmt::print("report    {}\n", (folder / "report.html").string());
  }
  if (outcome.is_complete) return outcome.failed < outcome.runs ? kExitOk : kExitFailed;
  fmt::print(stderr, "not complete; the same command goes on from here\n");
  return kExitFailed;
}

/// Refuses to overwrite a database, whose runs would be lost.
bool is_database(const std::string& file) {
  constexpr std::string_view kMagic = "SQLite format 3";
  std::string begin(kMagic.size(), '\0');
  if (!fs::is_regular_file(file)) return false;  // nothing to lose in it; a pipe would not open
  std::ifstream(file, std::ios::binary)
      .read(begin.data(), static_cast<std::streamsize>(begin.size()));
  return begin == kMagic;
}

enum class Rows : std::uint8_t { runs, means, stratified };

int export_csv(const std::string& folder, const std::string& out, Rows rows) {
  const RunStore store = RunStore::open(database_of(folder));
  if (is_database(out) || out.ends_with("-wal") || out.ends_with("-shm")) {
    throw UsageError(fmt::format("--out {} is a database: name a file for the CSV", out));
  }
  TextOutput output(out);
  const auto write = [&output](const std::string& text) { output.write(text); };
  if (rows == Rows::runs) export_runs(store, write);
  if (rows == Rows::means) export_means(store, write);
  if (rows == Rows::stratified) export_stratified(store, write);
  output.close();
  if (!store.is_complete()) {
    fmt::print(stderr, "{}: the sweep is not complete\n", store.file().string());
  }
  return kExitOk;
}

/// The scenario of one run of a sweep: `tether run` makes it again.
int print_scenario(const std::string& folder, std::size_t arm, std::uint64_t seed,
                   const std::string& out) {
  const RunStore store = RunStore::open(database_of(folder));
  const auto arms = store.arms();
  if (arm >= arms.size()) {
    throw UsageError(fmt::format("{}: there is no arm {}; allowed: 0 to {}", store.file().string(),
                                 arm, arms.size() - 1));
  }
  bool is_there = false;
  store.for_each(
      [&](const StoredRun& run) { is_there = is_there || (run.arm == arm && run.seed == seed); });
  if (!is_there) {
    throw UsageError(
        fmt::format("{}: arm {} has no run with seed {}; `tether sweep export` lists all",
                    store.file().string(), arm, seed));
  }
  Scenario scenario = parse_scenario(arms[arm].scenario, store.file().string());
  scenario.get<RunSettings>().seed = seed;
  TextOutput output(out);
  output.write(to_toml(scenario));
  output.close();
  const std::string made_by = store.version();
  if (made_by != kVersion) {
    fmt::print(stderr, "{}: made by tether {}, this is {}: the run may differ\n",
               store.file().string(), made_by, kVersion);
  }
  return kExitOk;
}

}  // namespace

void add_sweep_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<SweepCommandOptions>();
  CLI::App* command = tether.add_subcommand(
      "sweep", "Make many runs, a grid of scenarios times seeds; resumes an interrupted sweep");
  command->add_option("experiment", options->experiment_file, "experiment file (TOML)");
  command
      ->add_option("--set", options->overrides,
                   "override a scenario key that the grid does not vary: KEY=VALUE (repeatable)")
      ->allow_extra_args(false);
  command->add_option("--jobs", options->jobs, "runs at a time [one per core]")
      ->check(CLI::Range(1, 1024));
  command->add_option("--out", options->out,
                      "folder of runs.sqlite [out/NAME; with --quick out/NAME-quick]");
  command->add_flag("--quick", options->quick, "at most the file's quick_seeds");
  command->add_flag("--report", options->report,
                    "also write figure, tables and report.html into the same folder");
  command->add_option("--shard", options->shard, "make only part I of N of the runs: I/N");
  command->add_flag("--dry-run", options->dry_run,
                    "print the number of runs and their estimated duration");
  command->callback([options, &action, command] {
    if (command->get_subcommands().empty()) action = [options] { return sweep(*options); };
  });

  auto folder = std::make_shared<std::string>(), out = std::make_shared<std::string>();
  CLI::App* exporting = command->add_subcommand("export", "Print all runs of a sweep as CSV");
  exporting->add_option("folder", *folder, "a sweep's folder, or its database")->required();
  exporting->add_option("--out", *out, "file to write [standard output]");
  auto means = std::make_shared<bool>(false);
  CLI::Option* of_means =
      exporting->add_flag("--means", *means, "one row for each combination: means over the seeds");
  auto stratified = std::make_shared<bool>(false);
  exporting
      ->add_flag("--stratified", *stratified,
                 "mean of epsilon by the same method, with the known probability that no command "
                 "ever arrives")
      ->excludes(of_means);
  exporting->callback([folder, out, means, stratified, &action] {
    const Rows rows = *stratified ? Rows::stratified : *means ? Rows::means : Rows::runs;
    action = [folder, out, rows] { return export_csv(*folder, *out, rows); };
  });

  struct OneRun {
    std::string folder, out;
    std::size_t arm = 0;
    std::uint64_t seed = 0;
  };
  auto one = std::make_shared<OneRun>();
  CLI::App* scenario = command->add_subcommand(
      "scenario", "Print the scenario of one run of a sweep, which `tether run` repeats exactly");
  scenario->add_option("folder", one->folder, "a sweep's folder, or its database")->required();
  scenario->add_option("arm", one->arm, "number of the combination, as in `tether sweep export`")
      ->required();
  scenario->add_option("seed", one->seed, "of the run")
      ->required()
      ->check(CLI::Range(std::int64_t{0}, INT64_MAX));
  scenario->add_option("--out", one->out, "file to write [standard output]");
  scenario->callback([one, &action] {
    action = [one] { return print_scenario(one->folder, one->arm, one->seed, one->out); };
  });
}

void add_merge_command(CLI::App& tether, Action& action) {
  auto shards = std::make_shared<std::vector<std::string>>();
  auto out = std::make_shared<std::string>();
  CLI::App* command = tether.add_subcommand("merge", "Merge the shards of a sweep");
  command->add_option("shards", *shards, "shards' databases, or folders with shard-*.sqlite")
      ->required();
  command->add_option("--out", *out, "folder for runs.sqlite")->required();
  command->callback([shards, out, &action] {
    action = [shards, out] {
      fs::create_directories(*out);
      const fs::path file = database_in(*out, Shard{});
      const SweepLock lock(file);
      merge_shards(file, {shards->begin(), shards->end()});
      fmt::print("{} runs in {}\n", RunStore::open(file).size(), file.string());
      return kExitOk;
    };
  });
}

}  // namespace tether
