#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/program/cli.hpp"
#include "tools/base/replacing_output.hpp"
#include "tools/cli/commands.hpp"
#include "tools/experiment/sweep/gains.hpp"
#include "tools/experiment/sweep/seeds.hpp"
#include "tools/experiment/sweep/session.hpp"
#include "tools/experiment/sweep/tune.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

struct TuneCommandOptions {
  std::string file;
  std::vector<std::string> overrides;
  std::optional<std::size_t> jobs;
  std::string out;
  std::vector<std::string> laws;
  std::string keep;
  bool quick = false;
};

/// Inputs of a law's result: not --jobs and --out, nor which others are tuned.
std::string command_of(const TuneCommandOptions& options) {
  std::string command = "tether tune " + options.file;
  for (const std::string& text : options.overrides) command += " --set " + text;
  return command + (options.quick ? " --quick" : "");
}

void print_result(const Gains& gains) {
  fmt::print("{}, seeds of training; start of the search -> tuned\n", gains.objective);
  for (const TunedLaw& law : gains.laws) {
    fmt::print("{}: {:.4g} -> {:.4g}\n ", law.name, law.before, law.after);
    for (const auto& [key, value] : law.gains) fmt::print(" {} = {}", key, value);
    fmt::print("\n");
    if (law.found.size() > 1) fmt::print("  by search: {:.4g}\n", fmt::join(law.found, ", "));
    for (std::size_t i = 0; i < law.conditions.size(); ++i) {
      fmt::print("  {}: {:.4g} -> {:.4g}\n", law.conditions[i], law.means_before[i],
                 law.means_after[i]);
    }
  }
}

void print_front(const Tuning& tuning, const TuneResult& result, const fs::path& folder,
                 std::string& files) {
  std::vector<std::string> conditions;
  for (const TuningCondition& condition : tuning.conditions) conditions.push_back(condition.name);
  const fs::path file = folder / "front.csv";
  write_file(file, front_csv(result.front, conditions));
  fmt::print("\nLost vehicles against error of the others, seeds {}\n\n{}\n",
             seeds_text(tuning.front_seeds), front_table(result.front, conditions));
  files += fmt::format("front     {}\n", file.string());
}

int run_tune(const TuneCommandOptions& options) {
  if (options.file.empty()) throw UsageError("tune: name a tuning file (see --help)");
  const Tuning tuning = load_tuning(options.file, options.overrides, options.quick);
  const TuneChoice choice = chosen(tuning, options.laws, options.keep);
  const std::string name = tuning.name + (options.quick ? "-quick" : "");
  const fs::path folder = options.out.empty() ? fs::path("out") / name : fs::path(options.out);
  const auto result =
      tune(tuning, choice, folder, options.jobs.value_or(default_jobs()), command_of(options));
  if (!result) {
    fmt::print(stderr, "not complete; the same command goes on from here\n");
    return kExitFailed;
  }
  std::string files;
  for (std::size_t i = 0; i < result->gains.size(); ++i) {
    const bool is_of_survival = tuning.aims[i] == Aim::survival;
    const fs::path file = folder / (is_of_survival ? "gains_survival.toml" : "gains.toml");
    write_file(file, to_toml(result->gains[i]));
    print_result(result->gains[i]);
    files += fmt::format("gains     {}\n", file.string());
  }
  if (!result->front.empty()) print_front(tuning, *result, folder, files);
  fmt::print("{}", files);
  return kExitOk;
}

}  // namespace

void add_tune_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<TuneCommandOptions>();
  CLI::App* command = tether.add_subcommand(
      "tune", "Tune the gains of laws, all with the same effort; resumes an interrupted tuning");
  command->add_option("tuning", options->file, "tuning file (TOML)");
  command
      ->add_option("--set", options->overrides,
                   "override a scenario key of all runs: KEY=VALUE (repeatable)")
      ->allow_extra_args(false);
  command->add_option("--law", options->laws, "tune this law only (repeatable) [all of the file]")
      ->allow_extra_args(false);
  command->add_option("--keep", options->keep,
                      "with --law: file of gains, from which the other laws' gains are copied");
  command->add_option("--jobs", options->jobs, "runs at a time [one per core]")
      ->check(CLI::Range(1, 1024));
  command->add_option("--out", options->out,
                      "folder of gains.toml and all runs [out/NAME; with --quick out/NAME-quick]");
  command->add_flag("--quick", options->quick,
                    "at most the file's quick_seeds and quick_evaluations");
  command->callback([options, &action] { action = [options] { return run_tune(*options); }; });
}

}  // namespace tether
