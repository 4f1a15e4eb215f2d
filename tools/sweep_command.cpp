#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/cli.hpp"
#include "common/errors.hpp"
#include "tools/commands.hpp"
#include "tools/experiment/experiment.hpp"
#include "tools/experiment/sweep_export.hpp"
#include "tools/experiment/sweep_progress.hpp"
#include "tools/sweep_session.hpp"
#include "tools/text_output.hpp"

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
};

/// How long a run takes, from up to three arms.
double seconds_per_run(const Experiment& experiment) {
  const std::size_t last = experiment.arms.size() - 1;
  std::vector<std::size_t> arms{0, last / 2, last};
  arms.erase(std::unique(arms.begin(), arms.end()), arms.end());
  const auto start = std::chrono::steady_clock::now();
  for (const std::size_t arm : arms) {
    Scenario scenario = experiment.arms[arm].scenario;
    scenario.run.seed = experiment.seed(arm, 0);
    run_once(scenario, experiment.trajectory_period_s);
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
  const std::string what = experiment.arms.size() == 1
                               ? "1 combination"
                               : fmt::format("{} combinations", experiment.arms.size());
  if (least == most) {
    fmt::print("{} of {} seeds: {} runs, about {} on {} cores ({:.3f} s a run)\n", what,
               experiment.seeds.size(), most, duration(most), jobs, run_s);
  } else {
    fmt::print("{} of {} to {} seeds: {} to {} runs, about {} to {} on {} cores ({:.3f} s a run)\n",
               what, experiment.precision->batch, experiment.seeds.size(), least, most,
               duration(least), duration(most), jobs, run_s);
  }
  if (shard.count > 1) fmt::print("of these, shard {} makes one in {}\n", shard.index, shard.count);
  return kExitOk;
}

int sweep(const SweepCommandOptions& options) {
  if (options.experiment_file.empty()) {
    throw UsageError("sweep: name an experiment file (see --help)");
  }
  const Experiment experiment = load_experiment(options.experiment_file, options.overrides);
  const Shard shard = shard_of(options.shard);
  const std::size_t jobs = options.jobs.value_or(default_jobs());
  if (options.dry_run) return say_plan(experiment, shard, jobs);

  const fs::path folder =
      options.out.empty() ? fs::path("out") / experiment.name : fs::path(options.out);
  const SweepOutcome outcome = sweep_into(folder, experiment, shard, jobs);
  fmt::print("{} runs in {}{}\n", outcome.runs, outcome.database.string(),
             outcome.failed == 0
                 ? ""
                 : fmt::format(", of which {} failed (see `tether sweep export`)", outcome.failed));
  if (outcome.is_complete) return kExitOk;
  fmt::print(stderr, "stopped; the same command goes on from here\n");
  return kExitFailed;
}

int export_csv(const std::string& folder, const std::string& out, bool means) {
  const RunStore store = RunStore::open(database_of(folder));
  TextOutput output(out);
  const auto write = [&output](const std::string& text) { output.write(text); };
  means ? export_means(store, write) : export_runs(store, write);
  output.close();
  if (!store.is_complete()) {
    fmt::print(stderr, "{}: the sweep is not complete\n", store.file().string());
  }
  return kExitOk;
}

}  // namespace

void add_sweep_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<SweepCommandOptions>();
  CLI::App* command = tether.add_subcommand(
      "sweep", "Many runs: a grid of scenarios times seeds; goes on where it was interrupted");
  command->add_option("experiment", options->experiment_file, "experiment file (TOML)");
  command
      ->add_option("--set", options->overrides,
                   "override a scenario key that the grid does not vary: KEY=VALUE (repeatable)")
      ->allow_extra_args(false);
  command->add_option("--jobs", options->jobs, "runs at a time [one per core]")
      ->check(CLI::Range(1, 1024));
  command->add_option("--out", options->out, "folder of runs.sqlite [out/NAME]");
  command->add_option("--shard", options->shard, "make only part I of N of the runs: I/N");
  command->add_flag("--dry-run", options->dry_run,
                    "say how many runs there are and how long they take");
  command->callback([options, &action, command] {
    if (command->get_subcommands().empty()) action = [options] { return sweep(*options); };
  });

  auto folder = std::make_shared<std::string>(), out = std::make_shared<std::string>();
  CLI::App* exporting = command->add_subcommand("export", "All runs of a sweep as CSV");
  exporting->add_option("folder", *folder, "a sweep's folder, or its database")->required();
  exporting->add_option("--out", *out, "file to write [standard output]");
  auto means = std::make_shared<bool>(false);
  exporting->add_flag("--means", *means, "one row for each combination: means over the seeds");
  exporting->callback([folder, out, means, &action] {
    action = [folder, out, means] { return export_csv(*folder, *out, *means); };
  });
}

void add_merge_command(CLI::App& tether, Action& action) {
  auto shards = std::make_shared<std::vector<std::string>>();
  auto out = std::make_shared<std::string>();
  CLI::App* command = tether.add_subcommand("merge", "Put the shards of a sweep together");
  command->add_option("shards", *shards, "shards' databases, or folders with shard-*.sqlite")
      ->required();
  command->add_option("--out", *out, "folder for runs.sqlite")->required();
  command->callback([shards, out, &action] {
    action = [shards, out] {
      fs::create_directories(*out);
      const fs::path file = database_in(*out, Shard{});
      merge_shards(file, {shards->begin(), shards->end()});
      fmt::print("{} runs in {}\n", RunStore::open(file).size(), file.string());
      return kExitOk;
    };
  });
}

}  // namespace tether
