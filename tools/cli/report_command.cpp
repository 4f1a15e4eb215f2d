#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/share.hpp"
#include "common/program/cli.hpp"
#include "tools/base/process.hpp"
#include "tools/cli/commands.hpp"
#include "tools/experiment/report/report.hpp"
#include "tools/experiment/sweep/progress.hpp"
#include "tools/experiment/sweep/session.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

const std::map<std::string, RiskDefinition> kRisks{{"whole_run", RiskDefinition::whole_run},
                                                   {"next_10_s", RiskDefinition::next_10_s},
                                                   {"now", RiskDefinition::now}};

void add_risk_option(CLI::App* command, std::string& risk) {
  command
      ->add_option("--risk", risk,
                   "risk shown by risk maps where the channel is bad: whole_run (ε of these runs), "
                   "next_10_s or now (the error then) [whole_run]")
      ->check(CLI::IsMember(kRisks));
}

void print_claims(const Report& report) {
  for (const Claim& claim : report.claims) {
    fmt::print("{:<15} {:<7} {}\n{:24}{}\n", to_text(claim.verdict), claim.figure, claim.paper, "",
               claim.ours);
  }
}

void print_plants(const Report& report) {
  std::set<std::string> plants;
  for (const ReportSection& section : report.sections) plants.insert(section.plant);
  fmt::print("plant     {}\n", fmt::join(plants, ", "));
}

int report(const std::string& folder, const std::string& risk) {
  const Report report = write_report(folder, kRisks.at(risk));
  print_claims(report);
  print_plants(report);
  fmt::print("report    {}\n", (fs::path(folder) / "report.html").string());
  return kExitOk;
}

struct ReproduceOptions {
  bool quick = false;
  std::string out;  // empty: default_out()
  std::string experiments;
  std::string risk = "whole_run";
  std::vector<std::string> overrides;
  std::optional<std::size_t> jobs;
};

const std::vector<std::string> kFigures{"f1_paths", "f2_prr", "f3_delay", "f4_tau", "f5_risk"};

fs::path experiments_folder(const std::string& given) {
  fs::path folder = given.empty() ? shared_file("experiments") : fs::path(given);
  if (fs::exists(folder / (kFigures.front() + ".toml"))) return folder;
  throw UsageError(fmt::format("no {}.toml in {}: name the folder with --experiments",
                               kFigures.front(), folder.string()));
}

std::string default_out(bool quick) { return quick ? "out/reproduce-quick" : "out/reproduce"; }

int reproduce(ReproduceOptions options) {
  if (options.out.empty()) options.out = default_out(options.quick);
  const auto start = std::chrono::steady_clock::now();
  const fs::path source = experiments_folder(options.experiments);
  std::vector<Experiment> experiments, full;
  for (const std::string& name : kFigures) {
    const std::string file = (source / (name + ".toml")).string();
    experiments.push_back(load_experiment(file, options.overrides, options.quick));
    full.push_back(load_experiment(file, options.overrides));
  }
  const std::size_t jobs = options.jobs.value_or(default_jobs());
  double sweeps_s = 0.0, full_s = 0.0;
  for (std::size_t i = 0; i < experiments.size(); ++i) {
    const fs::path folder = fs::path(options.out) / kFigures[i];
    fmt::print(stderr, "{} ({} of {})\n", kFigures[i], i + 1, experiments.size());
    const SweepOutcome outcome = sweep_into(folder, experiments[i], Shard{}, jobs);
    if (!outcome.is_complete) {
      fmt::print(stderr, "not complete; the same command goes on from here\n");
      return kExitFailed;
    }
    const auto runs = [](const Experiment& e) {
      return static_cast<double>(e.arms.size() * e.seeds.size());
    };
    sweeps_s += outcome.wall_time_s;
    full_s += outcome.wall_time_s * runs(full[i]) / runs(experiments[i]);
  }
  const Report report = write_report(options.out, kRisks.at(options.risk));
  print_claims(report);
  print_plants(report);
  const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
  fmt::print("time      {}; the sweeps {} on {} cores\n", format_duration(taken.count()),
             format_duration(sweeps_s), jobs);
  if (options.quick) {
    fmt::print("full      without --quick: about {} on {} cores\n", format_duration(full_s), jobs);
  }
  fmt::print("report    {}\n", (fs::path(options.out) / "report.html").string());
  return kExitOk;
}

}  // namespace

void add_report_command(CLI::App& tether, Action& action) {
  auto folder = std::make_shared<std::string>();
  auto risk = std::make_shared<std::string>("whole_run");
  CLI::App* command = tether.add_subcommand(
      "report", "Write figures, tables and report.html of one or several sweeps");
  command->add_option("folder", *folder, "a sweep's folder, or one with sweeps' folders in it")
      ->required();
  add_risk_option(command, *risk);
  command->callback(
      [folder, risk, &action] { action = [folder, risk] { return report(*folder, *risk); }; });
}

void add_reproduce_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<ReproduceOptions>();
  CLI::App* command = tether.add_subcommand(
      "reproduce", "Reproduce the paper's five figures, and check its claims");
  command->add_flag("--quick", options->quick,
                    "few seeds: 658 runs, not 3914; 1 min 30 s on two fast cores");
  command->add_option("--out", options->out,
                      "folder for sweeps, figures and report.html [" + default_out(false) +
                          ", or " + default_out(true) + "]");
  command->add_option("--experiments", options->experiments,
                      "folder of the experiment files [the project's experiments/]");
  command
      ->add_option("--set", options->overrides,
                   "override a scenario key in all of them: KEY=VALUE (repeatable)")
      ->allow_extra_args(false);
  command->add_option("--jobs", options->jobs, "runs at a time [one per core]")
      ->check(CLI::Range(1, 1024));
  add_risk_option(command, options->risk);
  command->callback([options, &action] { action = [options] { return reproduce(*options); }; });
}

}  // namespace tether
