#include "tools/margin/design_search.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "common/base/errors.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "netem/statistics/estimate.hpp"
#include "tools/experiment/sweep/run_once.hpp"
#include "tools/margin/loop_margins.hpp"
#include "tools/margin/parallel.hpp"
#include "tools/runs/metric.hpp"

namespace tether {

namespace {

std::vector<RunResult> run_seeds(const Scenario& scenario, std::size_t seeds, std::size_t jobs) {
  std::vector<RunResult> results(seeds);
  for_each_index(seeds, jobs, [&](std::size_t i) {
    Scenario one = scenario;
    one.get<RunSettings>().seed = i + 1;
    results[i] = run_once(one, 0.0);
  });
  for (const RunResult& result : results) {
    if (!result.failure.empty()) throw std::runtime_error("a run failed: " + result.failure);
  }
  return results;
}

}  // namespace

FirstExcursion first_excursion_of_runs(const Scenario& scenario, std::size_t seeds,
                                       std::size_t jobs) {
  Scenario at_once = scenario;
  auto& run = at_once.get<RunSettings>();
  run.lost_for_s = 0.0;
  const std::size_t lost = *metric_number("lost"), when = *metric_number("lost_from_s");
  FirstExcursion first;
  first.beyond_m = run.lost_beyond_m;
  for (const RunResult& result : run_seeds(at_once, seeds, jobs)) {
    const double driven_s = result.metrics[when] - kSurvivalSettling_s;
    if (driven_s <= 0.0) continue;
    first.driven_s += driven_s;
    first.excursions += result.metrics[lost] > 0.5 ? 1 : 0;
  }
  first.mean_s = mean_time_interval(static_cast<double>(first.excursions), first.driven_s, 0.95);
  return first;
}

SettledError settled_error(const Scenario& scenario, std::size_t seeds, std::size_t jobs) {
  const std::vector<RunResult> results = run_seeds(scenario, seeds, jobs);
  const std::size_t metric = *metric_number("settled_epsilon_m");
  double sum = 0.0, squares = 0.0;
  for (const RunResult& result : results) {
    sum += result.metrics[metric];
    squares += result.metrics[metric] * result.metrics[metric];
  }
  const auto n = static_cast<double>(seeds);
  const double mean = sum / n, variance = std::max(0.0, squares / n - mean * mean) / (n - 1.0);
  return {mean, student_quantile(0.95, n - 1.0) * std::sqrt(variance)};
}

namespace {

class Search {
 public:
  explicit Search(const DesignQuestion& question) : q_(question), base_(load({})) {}

  DesignAnswer rate() {
    margin_loop({});  // throws if the loop at the scenario's own rate is refused
    for (const double hz :
         {1.0, 2.0, 4.0, 5.0, 8.0, 10.0, 12.5, 16.0, 20.0, 25.0, 40.0, 50.0, 100.0}) {
      const std::vector<std::string> set{fmt::format("sensor.rate_hz={}", hz)};
      std::optional<double> rms_m;
      try {
        rms_m = predicted_m(set);
      } catch (const UsageError&) {
        continue;  // a chain's steps, or plans, do not fit this rate
      }
      if (!rms_m || *rms_m > q_.target_m) continue;
      if (try_out(set, rms_text(*rms_m))) return answer_;
    }
    return none("no rate up to 100 Hz is good enough");
  }

  DesignAnswer tau() {
    need_law("pid", "tau");
    const StraightLoop loop = margin_loop({});
    const double best_s = 1.0 / loop.law(0, 0) - loop.timing.pose_delay_s;
    if (!(best_s > 0.0)) return none("the best look-ahead would be below 0");
    const std::vector<std::string> set{fmt::format("controller.tau_s={:.4g}", best_s)};
    return at_best(set, predicted_m(set));
  }

  DesignAnswer gains() {
    need_law("tracking", "gains");
    std::optional<double> least_m;
    std::vector<std::string> best;
    for (double k_y = 0.05; k_y < 6.0; k_y *= 1.2) {
      for (const double damping : {0.7, 0.85, 1.0, 1.2, 1.5, 2.0}) {
        const std::vector<std::string> set{
            fmt::format("controller.tracking.k_y={:.4g}", k_y),
            fmt::format("controller.tracking.k_theta={:.4g}", 2.0 * std::sqrt(k_y) * damping)};
        const auto rms_m = predicted_m(set);
        if (!rms_m || (least_m && *least_m <= *rms_m)) continue;
        least_m = rms_m;
        best = set;
      }
    }
    return at_best(best, least_m);
  }

  DesignAnswer horizon() {
    if (base_.get<ActuatorSettings>().policy != "horizon") {
      throw UsageError(fmt::format(
          "--find horizon: actuator.policy = \"{}\" must be \"horizon\", with a law that plans",
          base_.get<ActuatorSettings>().policy));
    }
    refuse_channel_obstacles(base_);
    const StraightLoop loop(base_);
    const double step_s = base_.get<ControllerSettings>().plan_step_ms * 1e-3;
    const auto periods = loop.chain().silence_periods(1e-3);
    if (!periods) {
      throw UsageError("--find horizon: the channel's silences are too long for any horizon");
    }
    const double silence_s = *periods * loop.timing.period_s;
    double horizon_s = step_s * std::ceil((silence_s + loop.timing.total_s()) / step_s);
    for (int i = 0; i < 8; ++i) {
      if (try_out({fmt::format("controller.horizon_s={:.4g}", horizon_s)},
                  fmt::format("one in 1000 silences is longer than {:.3g} s", silence_s))) {
        return answer_;
      }
      horizon_s = step_s * std::ceil(1.5 * horizon_s / step_s);
    }
    return none("runs miss the target with all of these");
  }

 private:
  Scenario load(const std::vector<std::string>& set) const {
    std::vector<std::string> all = q_.overrides;
    all.insert(all.end(), set.begin(), set.end());
    return load_scenario(q_.file, all);
  }

  StraightLoop margin_loop(const std::vector<std::string>& set) const {
    const Scenario scenario = load(set);
    refuse_margin_obstacles(scenario);
    return StraightLoop(scenario);
  }

  std::optional<double> predicted_m(const std::vector<std::string>& set) const {
    const StraightLoop loop = margin_loop(set);
    return loop.rms_m(loop.chain());
  }

  void need_law(const std::string& law, const std::string& what) const {
    const std::string& is = base_.get<ControllerSettings>().law;
    if (is == law) return;
    throw UsageError(
        fmt::format("--find {}: controller.law = \"{}\" must be \"{}\"", what, is, law));
  }

  static std::string rms_text(double rms_m) {
    return fmt::format("rms {:.4f} m on a straight", rms_m);
  }

  bool try_out(const std::vector<std::string>& set, const std::string& predicted) {
    DesignStep step{set, predicted, settled_error(load(set), q_.seeds, q_.jobs), false};
    step.good = step.simulated.mean_m + step.simulated.half_width_m <= q_.target_m;
    answer_.tried.push_back(step);
    return step.good;
  }

  DesignAnswer at_best(const std::vector<std::string>& set, const std::optional<double>& rms_m) {
    if (!rms_m) return none("the loop is unstable with all of them");
    if (*rms_m > q_.target_m) {
      return none(
          fmt::format("the best, {}, has a predicted rms error of {:.4f} m", set.front(), *rms_m));
    }
    if (!try_out(set, rms_text(*rms_m))) answer_.why_none = "runs miss the target";
    return answer_;
  }

  DesignAnswer none(const std::string& why) {
    answer_.why_none = why;
    return answer_;
  }

  const DesignQuestion& q_;
  Scenario base_;
  DesignAnswer answer_;
};

}  // namespace

DesignAnswer find_design(const DesignQuestion& question) {
  Search search(question);
  if (question.what == "rate") return search.rate();
  if (question.what == "tau") return search.tau();
  if (question.what == "gains") return search.gains();
  if (question.what == "horizon") return search.horizon();
  throw UsageError(fmt::format("--find {}: must be rate, tau, horizon or gains", question.what));
}

}  // namespace tether
