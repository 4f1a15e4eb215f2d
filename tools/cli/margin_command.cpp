#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "common/base/errors.hpp"
#include "common/program/cli.hpp"
#include "controller/tube/reach_tube.hpp"
#include "tools/base/json.hpp"
#include "tools/base/scenario_options.hpp"
#include "tools/base/text_output.hpp"
#include "tools/cli/commands.hpp"
#include "tools/experiment/sweep/experiment.hpp"
#include "tools/experiment/sweep/session.hpp"
#include "tools/margin/design_search.hpp"
#include "tools/margin/loop_margins.hpp"
#include "tools/margin/stability_map.hpp"
#include "tools/margin/survival.hpp"
#include "tools/margin/verification.hpp"

namespace tether {
namespace {

struct MarginOptions {
  ScenarioOptions scenario;
  bool json = false;
  std::string verify;  ///< an experiment
  bool quick = false;
  std::optional<std::size_t> jobs;
  std::string figure;  ///< *.png, *.svg
  std::string find;    ///< rate, tau, horizon, gains
  std::optional<double> target_m;
  std::string budget;  ///< "0.1m"
  std::size_t seeds = 20;

  std::size_t threads() const { return jobs.value_or(default_jobs()); }
};

std::string in_words(const Critical& critical, double factor, const char* unit,
                     const std::string& range = "the range looked at") {
  switch (critical.kind) {
    case Critical::Kind::found:
      return fmt::format("{:.3f}{}", critical.value * factor, unit);
    case Critical::Kind::always:
      return fmt::format("none in {}: always stable", range);
    case Critical::Kind::never:
      return fmt::format("none in {}: never stable", range);
    case Critical::Kind::not_monotone:
      break;
  }
  return "none: stability comes and goes";
}

nlohmann::ordered_json in_json(const Critical& critical) {
  static const char* const kNames[] = {"found", "always_stable", "never_stable", "not_monotone"};
  nlohmann::ordered_json json;
  json["kind"] = kNames[static_cast<int>(critical.kind)];
  json["value"] = nullptr;
  if (critical.kind == Critical::Kind::found) json["value"] = critical.value;
  return json;
}

/// Quantities that the mean square does not show: whether, and how soon, a vehicle leaves its path.
struct SurvivalMargins {
  Critical prr_each_way;
  std::optional<FirstExcursion> first;
};

std::string time_in_words(double s) {
  if (s < 600.0) return fmt::format("{:.0f} s", s);
  return s < 7200.0 ? fmt::format("{:.0f} min", s / 60.0) : fmt::format("{:.1f} h", s / 3600.0);
}

std::string survival_in_words(const SurvivalMargins& survival) {
  std::string text =
      fmt::format("almost surely   critical PRR {}\n",
                  in_words(survival.prr_each_way, 1.0, " each way: below it errors surely grow"));
  if (!survival.first) return text;
  const FirstExcursion& first = *survival.first;
  text += fmt::format("first excursion beyond {:g} m: ", first.beyond_m);
  if (first.excursions == 0) {
    text += fmt::format("none in {}, so {} on average at least", time_in_words(first.driven_s),
                        time_in_words(first.mean_s.low));
  } else {
    text += fmt::format("after {} on average, 95 % {} to {}", time_in_words(first.mean_s.value),
                        time_in_words(first.mean_s.low), time_in_words(first.mean_s.high));
  }
  return text +
         "\ndesign to       the first excursion: a finite mean square allows errors that are large "
         "and rare\n";
}

void add_survival(nlohmann::ordered_json& json, const SurvivalMargins& survival) {
  json["critical_prr_each_way_almost_surely"] = in_json(survival.prr_each_way);
  json["first_excursion"] = nullptr;
  if (!survival.first) return;
  const FirstExcursion& first = *survival.first;
  nlohmann::ordered_json& entry = json["first_excursion"];
  entry = {{"beyond_m", first.beyond_m}, {"excursions", first.excursions},
           {"driven_s", first.driven_s}, {"mean_s", nullptr},
           {"low_s", first.mean_s.low},  {"high_s", nullptr}};
  if (first.excursions == 0) return;
  entry["mean_s"] = first.mean_s.value;
  entry["high_s"] = first.mean_s.high;
}

std::string margins_in_words(const LoopMargins& m) {
  std::string text = fmt::format(
      "path speed      {:.3f} m/s at most, which is looked at; {:.3f} at least\n"
      "loop            a pose every {:g} ms, {:g} ms from pose to wheels, {:.4f} of the poses are "
      "answered\n"
      "mean square     {}: × {:.4f} a period across the path, {:.4f} along it\n"
      "critical PRR    {}\n",
      m.v_mps, m.least_mps, m.period_s * 1e3, m.delay_s * 1e3, m.prr,
      m.radius < 1.0 ? "stable" : "unstable", m.radius_across, m.radius_along,
      in_words(m.prr_each_way, 1.0, " each way, independent losses"));
  if (m.mean_burst) {
    text +=
        fmt::format("critical burst  {}\n", in_words(*m.mean_burst, 1.0, " packets on average"));
  }
  if (m.delays) {
    text += fmt::format(
        "critical delay  {}\n"
        "delay margin    {:.1f} ms without sampling and losses; {:.1f} ms where delays vary, hold "
        "included\n",
        in_words(m.delays->total_s, 1e3, " ms from pose to wheels, with these losses",
                 fmt::format("0 to {:g} ms", longest_delay_s(m.period_s) * 1e3)),
        m.delays->margin_s * 1e3, m.delays->varying_margin_s * 1e3);
  }
  if (m.rms_m) text += fmt::format("rms error       {:.4f} m on a straight\n", *m.rms_m);
  return text;
}

std::string margins_in_json(const LoopMargins& m, const SurvivalMargins& survival) {
  nlohmann::ordered_json json;
  json["v_mps"] = m.v_mps;
  json["least_mps"] = m.least_mps;
  json["period_s"] = m.period_s;
  json["delay_s"] = m.delay_s;
  json["prr"] = m.prr;
  json["stable"] = m.radius < 1.0;
  json["radius_across"] = m.radius_across;
  json["radius_along"] = m.radius_along;
  json["critical_prr_each_way"] = in_json(m.prr_each_way);
  if (m.mean_burst) json["critical_mean_burst"] = in_json(*m.mean_burst);
  json["critical_delay_s"] = json["delay_margin_s"] = json["varying_delay_margin_s"] = nullptr;
  if (m.delays) {
    json["critical_delay_s"] = in_json(m.delays->total_s);
    json["delay_margin_s"] = m.delays->margin_s;
    json["varying_delay_margin_s"] = m.delays->varying_margin_s;
  }
  json["rms_m"] = nullptr;
  if (m.rms_m) json["rms_m"] = *m.rms_m;
  add_survival(json, survival);
  return json_text(json, 2) + "\n";
}

/// One row after the other, as they are done: each takes a while.
int verify_experiment(const MarginOptions& options) {
  const Experiment experiment =
      load_experiment(options.verify, options.scenario.overrides(), options.quick);
  VerificationTrial trial;
  trial.seeds = experiment.seeds.size();
  trial.jobs = options.threads();
  const VerificationTable table(experiment);
  TextOutput out;
  bool all_hold = true;
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  if (!options.json) out.write(table.head());
  for (std::size_t i = 0; i < experiment.arms.size(); ++i) {
    const Arm& arm = experiment.arms[i];
    if (isatty(STDERR_FILENO) != 0) {
      fmt::print(stderr, "\r\033[K{} of {} arms", i, experiment.arms.size());
    }
    const auto rows = [&] {
      try {
        return verify_margins(arm.scenario, trial);
      } catch (const UsageError& error) {
        throw UsageError(fmt::format("{}: {}: {}", options.verify, arm.text(), error.what()));
      }
    }();
    if (isatty(STDERR_FILENO) != 0) fmt::print(stderr, "\r\033[K");
    for (const VerifiedCritical& row : rows) {
      all_hold = all_hold && row.holds();
      if (options.json) {
        json.push_back(verification_json(arm, row));
      } else {
        out.write(table.row(arm, row));
        out.flush();
      }
    }
  }
  if (options.json) out.write(json_text(json, 2) + "\n");
  out.close();
  return all_hold ? kExitOk : kExitFailed;
}

std::string design_in_words(const DesignAnswer& answer, double target_m) {
  std::string text;
  for (const DesignStep& step : answer.tried) {
    text += fmt::format("{}: {}; simulated ε {:.4f} ± {:.4f} m: {}\n", fmt::join(step.set, " "),
                        step.predicted, step.simulated.mean_m, step.simulated.half_width_m,
                        step.good ? "good" : "misses the target");
  }
  if (answer.found()) return text;
  return text + fmt::format("nothing found for {:g} m: {}\n", target_m, answer.why_none);
}

std::string design_in_json(const DesignAnswer& answer) {
  nlohmann::ordered_json json;
  json["found"] = answer.found();
  json["why_none"] = answer.found() ? "" : answer.why_none;
  json["tried"] = nlohmann::ordered_json::array();
  for (const DesignStep& step : answer.tried) {
    json["tried"].push_back({{"set", step.set},
                             {"predicted", step.predicted},
                             {"settled_epsilon_m", step.simulated.mean_m},
                             {"half_width_m", step.simulated.half_width_m},
                             {"good", step.good}});
  }
  return json_text(json, 2) + "\n";
}

int find(const MarginOptions& options) {
  constexpr double kTarget_m = 0.1;
  const double target_m = options.target_m.value_or(kTarget_m);
  const DesignAnswer answer =
      find_design({options.scenario.file, options.scenario.overrides(), options.find, target_m,
                   options.seeds, options.threads()});
  TextOutput out;
  out.write(options.json ? design_in_json(answer) : design_in_words(answer, target_m));
  out.close();
  return answer.found() ? kExitOk : kExitFailed;
}

/// "0.1m", "0.1 m" or "0.1".
double budget_m(const std::string& text) {
  std::size_t end = 0;
  double value = NAN;
  try {
    value = std::stod(text, &end);
  } catch (const std::exception&) {
    end = 0;
  }
  const std::string unit = text.substr(std::min(text.find_first_not_of(' ', end), text.size()));
  if (end > 0 && value > 0.0 && std::isfinite(value) && (unit.empty() || unit == "m")) return value;
  throw UsageError(fmt::format("--budget {}: must be a distance above 0, such as 0.1m", text));
}

int tell_budget(const MarginOptions& options) {
  const double most_m = budget_m(options.budget);
  auto overrides = options.scenario.overrides();
  overrides.emplace_back(
      "tube.silence_s=0.001");  // it is what is asked for: any lets bounds be set
  const LongestSilence longest =
      longest_silence(load_scenario(options.scenario.file, overrides), most_m);
  const bool found = longest.silence_s > 0.0;
  TextOutput out;
  if (options.json) {
    nlohmann::ordered_json json{{"budget_m", most_m}, {"silence_s", nullptr}};
    if (found) json["silence_s"] = longest.silence_s;
    json["or_longer"] = longest.or_longer;
    out.write(json_text(json, 2) + "\n");
  } else if (!found) {
    out.write(fmt::format("no silence keeps within {:g} m: at once it can be {:.3f} m off\n",
                          most_m, longest.at_once_m));
  } else {
    out.write(fmt::format("within {:g} m: silences of {} {:g} s, which can.max_blind_s may be\n",
                          most_m, longest.or_longer ? "at least" : "up to", longest.silence_s));
  }
  out.close();
  return found ? kExitOk : kExitFailed;
}

void draw(const MarginOptions& options) {
  constexpr double kLimit_m = 0.5;
  const Scenario scenario = options.scenario.load();
  draw_stability_map(options.figure, scenario,
                     stability_map(scenario, options.target_m.value_or(kLimit_m), options.seeds,
                                   options.threads()));
}

int tell_margins(const MarginOptions& options) {
  if (!options.verify.empty()) return verify_experiment(options);
  if (options.target_m && !std::isfinite(*options.target_m)) {
    throw UsageError("--target: must be a number of metres");
  }
  if (options.scenario.file.empty()) {
    throw UsageError("tether margin: name a scenario, or an experiment with --verify");
  }
  if (!options.find.empty()) return find(options);
  if (!options.budget.empty()) return tell_budget(options);
  const Scenario scenario = options.scenario.load();
  if (!options.figure.empty()) {
    check_map_file(options.figure);
    check_map(scenario);
  }
  const LoopMargins margins = loop_margins(scenario);
  const SurvivalMargins survival{almost_sure_prr(scenario), first_excursion(scenario)};
  TextOutput out;
  out.write(options.json ? margins_in_json(margins, survival)
                         : margins_in_words(margins) + survival_in_words(survival));
  out.close();
  if (!options.figure.empty()) draw(options);
  return kExitOk;
}

}  // namespace

void add_margin_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<MarginOptions>();
  CLI::App* const command = tether.add_subcommand(
      "margin",
      "Compute how much loss and delay a scenario's loop survives: mean-square stability, critical "
      "PRR, burst and delay, and the error that noise leaves. Refuses "
      "scenarios for which the theory "
      "does not hold");
  add_scenario(*command, options->scenario);
  command->add_option("--verify", options->verify,
                      "experiment file: for each arm, predicted and simulated critical values, "
                      "with 95 % intervals");
  command->add_flag("--quick", options->quick, "with --verify: at most the file's quick_seeds");
  auto* const figure =
      command->add_option("--figure", options->figure,
                          "draw the stable region by PRR and delay, and results of runs: *.png "
                          "or *.svg");
  auto* const find =
      command
          ->add_option(
              "--find", options->find,
              "parameter to find for --target under the scenario's channel; checked by runs")
          ->check(CLI::IsMember({"rate", "tau", "horizon", "gains"}));
  command
      ->add_option("--target", options->target_m,
                   "error, m: for --find [0.1]; runs of --figure below it count as stable [0.5]")
      ->check(number_between(1e-6, 1e6));
  auto* const budget =
      command->add_option("--budget", options->budget,
                          "compute the longest silence after which a vehicle that follows plans is "
                          "within this distance of its plan, by the bounds of [tube]: 0.1m");
  find->excludes(figure, budget);
  budget->excludes(figure);
  command->add_option("--seeds", options->seeds, "runs of each check or point [20]")
      ->check(CLI::Range(2, 100000));
  command->add_option("--jobs", options->jobs, "runs at a time [one per core]")
      ->check(CLI::Range(1, 1024));
  command->add_flag("--json", options->json, "print one JSON object");
  command->callback([options, &action] { action = [options] { return tell_margins(*options); }; });
}

}  // namespace tether
