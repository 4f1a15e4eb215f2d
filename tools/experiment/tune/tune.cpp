#include "tools/experiment/tune/tune.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <utility>

#include "common/version.hpp"
#include "tools/experiment/store/run_store.hpp"
#include "tools/experiment/sweep/session.hpp"
#include "tools/runs/metric.hpp"

namespace tether {
namespace {

/// A law's values that are tried, and what came of them.
struct Candidate {
  std::vector<double> values;
  Worth worth;
};

/// A law's search so far.
struct LawSearch {
  const TuningLaw* law;
  std::vector<SearchedPoint> searched;
  std::vector<Candidate> tried;  // one for each of `searched`
};

SearchPoint start_of(const TuningLaw& law) {
  SearchPoint start(law.keys.size());
  for (std::size_t i = 0; i < start.size(); ++i) {
    start[i] = law.keys[i].coordinate_of(law.start[i]);
  }
  return start;
}

std::vector<double> values_at(const TuningLaw& law, const SearchPoint& point) {
  std::vector<double> values(point.size());
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = law.keys[i].at(point[i]);
  return values;
}

/// Of one sweep: each candidate of each law, an arm for each of its conditions, in this order.
Experiment experiment_of(const Tuning& tuning, std::size_t round,
                         const std::vector<LawSearch>& searches,
                         const std::vector<std::vector<SearchPoint>>& points) {
  Experiment experiment;
  experiment.name = fmt::format("round{}", round);
  experiment.keys = {"law", "candidate", "condition"};
  experiment.seeds = tuning.seeds;
  experiment.overrides = tuning.overrides;
  for (std::size_t i = 0; i < searches.size(); ++i) {
    const TuningLaw& law = *searches[i].law;
    for (std::size_t n = 0; n < points[i].size(); ++n) {
      const std::size_t number = searches[i].tried.size() + n;
      const auto values = number == 0 ? law.start : values_at(law, points[i][n]);
      for (const std::size_t condition : law.conditions) {
        experiment.arms.push_back(
            {{{"law", fmt::format("\"{}\"", law.name)},
              {"candidate", std::to_string(number)},
              {"condition", fmt::format("\"{}\"", tuning.conditions[condition].name)}},
             tuning.scenario_of(law, condition, values)});
      }
    }
  }
  return experiment;
}

/// The metric of all runs, by arm.
std::vector<std::vector<double>> metrics_in(const std::filesystem::path& database,
                                            const std::string& metric, std::size_t arms) {
  const std::size_t number = metric_number(metric).value();
  std::vector<std::vector<double>> values(arms);
  RunStore::open(database).for_each([&](const StoredRun& run) {
    values[run.arm].push_back(run.result.failure.empty()
                                  ? run.result.metrics[number]
                                  : std::numeric_limits<double>::quiet_NaN());
  });
  return values;
}

void add_results(const Tuning& tuning, const std::vector<std::vector<double>>& by_arm,
                 const std::vector<std::vector<SearchPoint>>& points,
                 std::vector<LawSearch>& searches) {
  auto arm = by_arm.begin();
  for (std::size_t i = 0; i < searches.size(); ++i) {
    LawSearch& search = searches[i];
    for (const SearchPoint& point : points[i]) {
      const auto end = arm + static_cast<std::ptrdiff_t>(search.law->conditions.size());
      const auto values = search.tried.empty() ? search.law->start : values_at(*search.law, point);
      search.tried.push_back({values, worth_of(tuning, {arm, end})});
      search.searched.push_back({point, search.tried.back().worth.objective});
      arm = end;
    }
  }
  assert(arm == by_arm.end());
}

TunedLaw result_of(const Tuning& tuning, const LawSearch& search) {
  TunedLaw tuned;
  const TuningLaw& law = *search.law;
  const Candidate &before = search.tried.front(), &after = search.tried[best_of(search.searched)];
  tuned.name = law.name;
  for (const PlacedSetting& given : law.settings) tuned.settings.push_back(given.setting);
  for (std::size_t i = 0; i < law.keys.size(); ++i) {
    tuned.gains.push_back({law.keys[i].key, number_text(after.values[i])});
  }
  for (const std::size_t i : law.conditions) tuned.conditions.push_back(tuning.conditions[i].name);
  tuned.before = before.worth.objective;
  tuned.after = after.worth.objective;
  tuned.means_before = before.worth.means;
  tuned.means_after = after.worth.means;
  return tuned;
}

}  // namespace

Worth worth_of(const Tuning& tuning, const std::vector<std::vector<double>>& metrics) {
  Worth worth;
  for (const std::vector<double>& runs : metrics) {
    double sum = 0.0;
    for (const double value : runs) {
      sum += std::isfinite(value) ? std::min(value, tuning.most) : tuning.most;
    }
    worth.means.push_back(sum / static_cast<double>(runs.size()));
  }
  double sum = 0.0;
  for (const double mean : worth.means) sum += tuning.is_geometric ? std::log(mean) : mean;
  const double mean = sum / static_cast<double>(worth.means.size());
  worth.objective = tuning.is_geometric ? std::exp(mean) : mean;
  return worth;
}

std::optional<Gains> tune(const Tuning& tuning, const std::filesystem::path& folder,
                          std::size_t jobs, const std::string& command) {
  std::vector<LawSearch> searches;
  for (const TuningLaw& law : tuning.laws) searches.push_back({&law, {}, {}});
  const std::size_t rounds = round_sizes(tuning.budget).size();
  for (std::size_t round = 1; round <= rounds; ++round) {
    std::vector<std::vector<SearchPoint>> points;
    for (const LawSearch& search : searches) {
      points.push_back(next_points(tuning.budget, start_of(*search.law), search.searched));
    }
    const Experiment experiment = experiment_of(tuning, round, searches, points);
    fmt::print(stderr, "round {} of {}: {} candidates of each of {} laws, {} runs\n", round, rounds,
               points.front().size(), searches.size(),
               experiment.arms.size() * experiment.seeds.size());
    const SweepOutcome outcome = sweep_into(folder / experiment.name, experiment, {}, jobs);
    if (!outcome.is_complete) return std::nullopt;
    const auto metrics = metrics_in(outcome.database, tuning.metric, experiment.arms.size());
    add_results(tuning, metrics, points, searches);
  }
  Gains gains;
  gains.version = kVersion;
  gains.command = command;
  gains.objective = tuning.objective();
  gains.seeds = tuning.seeds;
  gains.evaluations = tuning.budget.evaluations;
  for (const LawSearch& search : searches) gains.laws.push_back(result_of(tuning, search));
  return gains;
}

}  // namespace tether
