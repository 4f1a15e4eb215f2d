#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/cli.hpp"
#include "common/errors.hpp"
#include "common/system_error.hpp"
#include "tools/commands.hpp"
#include "tools/experiment/experiment.hpp"
#include "tools/experiment/sweep.hpp"
#include "tools/experiment/sweep_export.hpp"
#include "tools/experiment/sweep_progress.hpp"
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

std::atomic<bool> stop{false};

double mean_half_width(const std::vector<double>& v) {
  double m = 0, q = 0;
  for (double x : v) m += x / v.size();
  for (double x : v) q += (x - m) * (x - m);
  return 2 * std::sqrt(q / (v.size() - 1) / v.size());
}

/// Ctrl-C and SIGTERM end the sweep after the runs under way.
void stop_on_signals() {
  struct sigaction action {};
  action.sa_handler = [](int) { stop = true; };
  action.sa_flags = static_cast<int>(SA_RESETHAND);  // a second one ends it at once
  for (const int signal : {SIGINT, SIGTERM}) sigaction(signal, &action, nullptr);
}

/// Keeps another process from sweeping into the same database at the same time.
class SweepLock {
 public:
  explicit SweepLock(const fs::path& database) : file_(database.string() + ".lock") {
    fd_ = check_system_call("making " + file_,
                            open(file_.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0666));
    if (flock(fd_, LOCK_EX | LOCK_NB) == 0) return;
    close(fd_);
    throw UsageError(fmt::format("another process is sweeping into {}", database.string()));
  }
  ~SweepLock() {
    unlink(file_.c_str());
    close(fd_);
  }
  SweepLock(const SweepLock&) = delete;
  SweepLock& operator=(const SweepLock&) = delete;

 private:
  std::string file_;
  int fd_ = -1;
};

fs::path made_folder(const std::string& out, const Experiment& experiment) {
  fs::path folder = out.empty() ? fs::path("out") / experiment.name : fs::path(out);
  std::error_code error;
  fs::create_directories(folder, error);
  if (!fs::is_directory(folder)) {
    throw UsageError(fmt::format("cannot make the folder {}: {}", folder.string(),
                                 error ? error.message() : "it is a file"));
  }
  return folder;
}

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
  const std::size_t jobs =
      options.jobs.value_or(std::max<std::size_t>(1, std::thread::hardware_concurrency()));
  if (options.dry_run) return say_plan(experiment, shard, jobs);

  const fs::path database = database_in(made_folder(options.out, experiment), shard);
  const SweepLock lock(database);
  RunStore store = RunStore::begin(database, experiment, shard);
  const std::size_t before = store.size();
  if (before > 0) fmt::print(stderr, "{} has {} runs already\n", database.string(), before);
  stop_on_signals();
  ProgressBar bar;
  const SweepOptions how{jobs, mean_half_width, [&bar](const SweepProgress& p) { bar.show(p); },
                         run_once};
  const bool is_complete = run_sweep(experiment, shard, store, how, stop);
  bar.end();
  const std::size_t failures = store.failures();
  fmt::print("{} runs in {}{}\n", store.size(), database.string(),
             failures == 0
                 ? ""
                 : fmt::format(", of which {} failed (see `tether sweep export`)", failures));
  if (is_complete) return kExitOk;
  fmt::print(stderr, "stopped; the same command goes on from here\n");
  return kExitFailed;
}

int export_csv(const std::string& folder, const std::string& out) {
  const RunStore store = RunStore::open(database_of(folder));
  TextOutput output(out);
  export_runs(store, [&output](const std::string& text) { output.write(text); });
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
  exporting->callback(
      [folder, out, &action] { action = [folder, out] { return export_csv(*folder, *out); }; });
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
