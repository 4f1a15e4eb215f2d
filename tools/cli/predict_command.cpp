#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/program/cli.hpp"
#include "tools/base/replacing_output.hpp"
#include "tools/base/table.hpp"
#include "tools/cli/commands.hpp"
#include "tools/experiment/statistics/survival.hpp"
#include "tools/experiment/sweep/data.hpp"
#include "tools/experiment/sweep/export.hpp"
#include "tools/experiment/sweep/prediction.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

struct PredictOptions {
  std::string sweep;
  std::string metric = "epsilon_m";
  double tolerance = 0.0;
  std::string out;
  std::string check;
};

void print_source(const Prediction& p, const std::string& file) {
  fmt::print("{}: {} of {} {}, plant {}, {} seeds\ndigest {}\n\n", file, p.metric, p.name,
             p.version, p.plant, p.seeds.size(), digest_of(p));
}

std::string interval_of(const PredictedArm& arm) {
  if (arm.values < 2) return "too few runs";
  return fmt::format("{:.4g} to {:.4g} ({:.1f} %)", arm.interval.low, arm.interval.high,
                     100.0 * arm.coverage());
}

int write_prediction(const PredictOptions& options) {
  const Prediction p =
      predict(RunStore::open(database_of(options.sweep)), options.metric, options.tolerance);
  const std::string file = options.out.empty() ? p.name + ".prediction.json" : options.out;
  if (fs::exists(file) && !(read_prediction(file) == p)) {
    throw UsageError(fmt::format(
        "{} holds another prediction, which must not change any more: name another --out", file));
  }
  write_file(file, to_json(p));
  print_source(p, file);
  std::vector<std::vector<std::string>> rows{{"setting", "one new run", "lost"}};
  for (const PredictedArm& arm : p.arms) {
    rows.push_back({settings_text(arm.settings), interval_of(arm),
                    share_text(share_of(arm.lost, arm.runs, kConfidence))});
  }
  print_table(rows);
  return kExitOk;
}

std::vector<MeasuredArm> measured(const std::string& path, const Prediction& prediction) {
  const bool is_sweep = fs::is_directory(path) || path.ends_with(".sqlite");
  return is_sweep ? measured_in(RunStore::open(database_of(path)), prediction)
                  : measured_in_table(path, prediction);
}

int check(const PredictOptions& options) {
  const Prediction p = read_prediction(options.check);
  const auto checked = check_prediction(p, measured(options.sweep, p));
  print_source(p, options.check);
  std::vector<std::vector<std::string>> rows{
      {"setting", "predicted for a run", "measured", "p", "lost: predicted", "measured", "p", ""}};
  std::size_t holding = 0;
  for (const CheckedArm& arm : checked) {
    const bool holds = arm.within_holds && arm.lost_holds;
    holding += holds ? 1 : 0;
    rows.push_back({settings_text(arm.predicted->settings), interval_of(*arm.predicted),
                    fmt::format("{} of {} within", arm.within, arm.values),
                    fmt::format("{:.2g}", arm.p_within),
                    fmt::format("{}/{}", arm.predicted->lost, arm.predicted->runs),
                    fmt::format("{}/{}", arm.lost, arm.runs), fmt::format("{:.2g}", arm.p_lost),
                    holds              ? "holds"
                    : arm.within_holds ? "does not hold: lost"
                    : arm.lost_holds   ? "does not hold: " + p.metric
                                       : "does not hold"});
  }
  print_table(rows);
  fmt::print("\n{} of {} settings hold; {} of {} predicted settings were measured\n", holding,
             checked.size(), checked.size(), p.arms.size());
  return holding == checked.size() ? kExitOk : kExitFailed;
}

}  // namespace

void add_predict_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<PredictOptions>();
  CLI::App* command = tether.add_subcommand(
      "predict", "Write down what a sweep says of runs to come, and compare a later measurement");
  command
      ->add_option("sweep", options->sweep,
                   "folder or database of a complete sweep; with --check, what was measured: "
                   "another sweep, or a CSV table with a row for each run")
      ->required();
  CLI::Option* metric =
      command->add_option("--metric", options->metric, "metric of a run, or an expression of them")
          ->capture_default_str();
  CLI::Option* tolerance =
      command
          ->add_option(
              "--tolerance", options->tolerance,
              "difference that does not matter, in the metric's unit: widens all intervals")
          ->check(number_between(0.0, 1e9))
          ->capture_default_str();
  CLI::Option* out =
      command->add_option("--out", options->out, "file of the prediction [NAME.prediction.json]");
  command
      ->add_option("--check", options->check,
                   "prediction to compare with; exit code 1 if it does not hold")
      ->excludes(metric)
      ->excludes(tolerance)
      ->excludes(out);
  command->callback([options, &action] {
    action = [options] {
      return options->check.empty() ? write_prediction(*options) : check(*options);
    };
  });
}

}  // namespace tether
