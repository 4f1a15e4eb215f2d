#include "tools/experiment/sweep/tune.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cassert>
#include <cctype>
#include <cmath>
#include <limits>
#include <utility>

#include "common/base/errors.hpp"
#include "common/version.hpp"
#include "tools/experiment/sweep/run_store.hpp"
#include "tools/experiment/sweep/session.hpp"
#include "tools/runs/metric.hpp"

namespace tether {
namespace {

/// A law's values that are tried, and what came of them.
struct Candidate {
  std::vector<double> values;
  Worth worth;
};

/// One of a law's searches so far.
struct Search {
  Aim aim = Aim::error;
  SearchBudget budget;
  std::vector<SearchPoint> given;
  std::vector<SearchedPoint> searched;
  std::vector<Candidate> tried;  // one for each of `searched`
};

using Round = std::vector<std::vector<SearchPoint>>;  // each search's points

/// Whether a search begins with what the law gives: the first of each aim.
bool begins_with_given(const TuningLaw& law, std::size_t n) { return n % law.searches == 0; }

/// The searches of each aim in turn. Searches after the first begin where the sequence is after the
/// points of those before.
std::vector<Search> searches_of(const Tuning& tuning, const TuningLaw& law) {
  std::vector<SearchPoint> given;
  for (const std::vector<double>& values : law.given) {
    given.emplace_back();
    for (std::size_t i = 0; i < law.keys.size(); ++i) {
      given.back().push_back(law.keys[i].coordinate_of(values[i]));
    }
  }
  std::vector<Search> searches;
  for (std::size_t n = 0; n < tuning.aims.size() * law.searches; ++n) {
    Search search{tuning.aims[n / law.searches], law.budget, given, {}, {}};
    search.budget.skipped = n * law.budget.evaluations;
    if (!begins_with_given(law, n)) {
      search.given = {sequence_point(law.keys.size(), search.budget.skipped)};
    }
    searches.push_back(search);
  }
  return searches;
}

/// The values of candidate `number` of search `n`.
std::vector<double> values_at(const TuningLaw& law, std::size_t n, std::size_t number,
                              const SearchPoint& point) {
  if (begins_with_given(law, n) && number < law.given.size()) return law.given[number];
  std::vector<double> values(point.size());
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = law.keys[i].at(point[i]);
  return values;
}

/// Experiment of one sweep: each candidate of each search, an arm for each condition, in this
/// order.
Experiment experiment_of(const Tuning& tuning, const TuningLaw& law, std::size_t round,
                         const std::vector<Search>& searches, const Round& points) {
  Experiment experiment;
  experiment.name = fmt::format("round{}", round);
  experiment.keys = {"search", "candidate", "condition"};
  experiment.seeds = law.seeds;
  experiment.overrides = tuning.overrides;
  for (std::size_t n = 0; n < searches.size(); ++n) {
    for (std::size_t i = 0; i < points[n].size(); ++i) {
      const std::size_t number = searches[n].tried.size() + i;
      const auto values = values_at(law, n, number, points[n][i]);
      for (const std::size_t condition : law.conditions) {
        experiment.arms.push_back(
            {{{"search", std::to_string(n + 1)},
              {"candidate", std::to_string(number)},
              {"condition", fmt::format("\"{}\"", tuning.conditions[condition].name)}},
             tuning.scenario_of(law, condition, values)});
      }
    }
  }
  return experiment;
}

/// All runs, by arm.
std::vector<std::vector<TunedRun>> runs_in(const std::filesystem::path& database,
                                           const std::string& metric, std::size_t arms) {
  const std::size_t number = metric_number(metric).value();
  const std::size_t lost = metric_number("lost").value();
  std::vector<std::vector<TunedRun>> runs(arms);
  RunStore::open(database).for_each([&](const StoredRun& run) {
    const bool is_known = run.result.failure.empty();
    runs[run.arm].push_back(
        is_known ? TunedRun{run.result.metrics[number], run.result.metrics[lost] > 0.5}
                 : TunedRun{std::numeric_limits<double>::quiet_NaN(), true});
  });
  return runs;
}

void add_results(const Tuning& tuning, const TuningLaw& law,
                 const std::vector<std::vector<TunedRun>>& by_arm, const Round& points,
                 std::vector<Search>& searches) {
  auto arm = by_arm.begin();
  for (std::size_t n = 0; n < searches.size(); ++n) {
    Search& search = searches[n];
    for (const SearchPoint& point : points[n]) {
      const auto end = arm + static_cast<std::ptrdiff_t>(law.conditions.size());
      const auto values = values_at(law, n, search.tried.size(), point);
      search.tried.push_back({values, worth_of(tuning.rule, {arm, end})});
      search.searched.push_back({point, search.tried.back().worth.objective(search.aim)});
      arm = end;
    }
  }
  assert(arm == by_arm.end());
}

/// The law before it is tuned: its gains have no values.
TunedLaw untuned(const Tuning& tuning, const TuningLaw& law) {
  TunedLaw tuned;
  tuned.name = law.name;
  tuned.seeds = law.seeds;
  tuned.evaluations = law.budget.evaluations;
  for (const PlacedSetting& given : law.settings) tuned.settings.push_back(given.setting);
  for (const TunedKey& key : law.keys) tuned.gains.push_back({key.key, ""});
  for (const std::size_t i : law.conditions) tuned.conditions.push_back(tuning.conditions[i].name);
  return tuned;
}

/// Whether gains are of this law with this effort; what they are worth is not looked at.
bool is_of(const TunedLaw& tuned, const Tuning& tuning, const TuningLaw& law) {
  TunedLaw expected = untuned(tuning, law);
  for (std::size_t i = 0; i < std::min(tuned.gains.size(), expected.gains.size()); ++i) {
    expected.gains[i].value = tuned.gains[i].value;
  }
  return tuned.settings == expected.settings && tuned.gains == expected.gains &&
         tuned.conditions == expected.conditions && tuned.seeds == expected.seeds &&
         tuned.evaluations == expected.evaluations && tuned.found.size() == law.searches;
}

/// Settings and gains that have an effect.
void put_values(const Tuning& tuning, const TuningLaw& law, const std::vector<double>& values,
                TunedLaw& tuned) {
  const TuningLaw::Chosen chosen = tuning.chosen(law, values);
  tuned.settings.clear();
  tuned.gains.clear();
  for (const PlacedSetting& given : chosen.settings) tuned.settings.push_back(given.setting);
  for (const PlacedSetting& given : chosen.gains) tuned.gains.push_back(given.setting);
}

/// Result of the searches for one aim.
TunedLaw result_of(const Tuning& tuning, const TuningLaw& law,
                   const std::vector<Search>& searches) {
  TunedLaw tuned = untuned(tuning, law);
  std::vector<SearchedPoint> best;
  for (const Search& search : searches) {
    best.push_back(search.searched[best_of(search.searched)]);
    tuned.found.push_back(best.back().objective);
  }
  const Search& search = searches[best_of(best)];
  const Candidate& before = searches.front().tried.front();
  const Candidate& after = search.tried[best_of(search.searched)];
  put_values(tuning, law, after.values, tuned);
  tuned.version = kVersion;
  tuned.before = before.worth.objective(search.aim);
  tuned.after = after.worth.objective(search.aim);
  tuned.means_before = before.worth.means;
  tuned.means_after = after.worth.means;
  return tuned;
}

/// Nullopt: interrupted.
std::optional<std::vector<FrontPoint>> measure_front(const Tuning& tuning, const TuningLaw& law,
                                                     const std::vector<Search>& searches,
                                                     const std::filesystem::path& folder,
                                                     std::size_t jobs) {
  std::vector<Candidate> tried;
  std::vector<Worth> worths;
  for (const Search& search : searches) {
    for (const Candidate& candidate : search.tried) {
      tried.push_back(candidate);
      worths.push_back(candidate.worth);
    }
  }
  const std::vector<std::size_t> front = front_of(worths, kFrontPoints);
  Experiment experiment;
  experiment.name = "front";
  experiment.keys = {"point", "condition"};
  experiment.seeds = tuning.front_seeds;
  experiment.overrides = tuning.overrides;
  for (std::size_t point = 0; point < front.size(); ++point) {
    for (const std::size_t condition : law.conditions) {
      experiment.arms.push_back(
          {{{"point", std::to_string(point + 1)},
            {"condition", fmt::format("\"{}\"", tuning.conditions[condition].name)}},
           tuning.scenario_of(law, condition, tried[front[point]].values)});
    }
  }
  fmt::print(stderr, "{}: front, {} candidates, {} runs\n", law.name, front.size(),
             experiment.arms.size() * experiment.seeds.size());
  const SweepOutcome outcome = sweep_into(folder / experiment.name, experiment, {}, jobs);
  if (!outcome.is_complete) return std::nullopt;
  const auto runs = runs_in(outcome.database, tuning.metric, experiment.arms.size());
  std::vector<FrontPoint> points;
  for (std::size_t point = 0; point < front.size(); ++point) {
    TunedLaw tuned;
    put_values(tuning, law, tried[front[point]].values, tuned);
    const auto conditions = static_cast<std::ptrdiff_t>(law.conditions.size());
    const auto first = runs.begin() + static_cast<std::ptrdiff_t>(point) * conditions;
    points.push_back(front_point(law.name, tuned.gains, tuning.rule, {first, first + conditions}));
  }
  return points;
}

/// Nullopt: interrupted.
std::optional<std::vector<Search>> searched(const Tuning& tuning, const TuningLaw& law,
                                            const std::filesystem::path& folder, std::size_t jobs) {
  std::vector<Search> searches = searches_of(tuning, law);
  const std::size_t rounds = round_sizes(law.budget).size();
  for (std::size_t round = 1; round <= rounds; ++round) {
    Round points;
    for (const Search& search : searches) {
      points.push_back(next_points(search.budget, search.given, search.searched));
    }
    const Experiment experiment = experiment_of(tuning, law, round, searches, points);
    fmt::print(stderr, "{}: round {} of {}, {} candidates, {} runs\n", law.name, round, rounds,
               experiment.arms.size() / law.conditions.size(),
               experiment.arms.size() * experiment.seeds.size());
    const SweepOutcome outcome = sweep_into(folder / experiment.name, experiment, {}, jobs);
    if (!outcome.is_complete) return std::nullopt;
    const auto runs = runs_in(outcome.database, tuning.metric, experiment.arms.size());
    add_results(tuning, law, runs, points, searches);
  }
  return searches;
}

/// Adds a law's gains for each aim and its front to `result`. False: interrupted.
bool tune_law(const Tuning& tuning, const TuningLaw& law, const std::filesystem::path& folder,
              std::size_t jobs, TuneResult& result) {
  const auto searches = searched(tuning, law, folder, jobs);
  if (!searches) return false;
  auto first = searches->begin();
  for (Gains& gains : result.gains) {
    const auto end = first + static_cast<std::ptrdiff_t>(law.searches);
    gains.laws.push_back(result_of(tuning, law, {first, end}));
    first = end;
  }
  if (tuning.front_seeds.empty()) return true;
  const auto front = measure_front(tuning, law, *searches, folder, jobs);
  if (!front) return false;
  result.front.insert(result.front.end(), front->begin(), front->end());
  return true;
}

}  // namespace

bool TuneChoice::is_to_be_tuned(const std::string& law) const {
  return laws.empty() || std::find(laws.begin(), laws.end(), law) != laws.end();
}

std::string folder_of(const std::string& law) {
  std::string name;
  for (const char c : law) {
    const bool is_plain = std::isalnum(static_cast<unsigned char>(c)) != 0;
    if (is_plain || (!name.empty() && name.back() != '-')) name += is_plain ? c : '-';
  }
  return name;
}

TuneChoice chosen(const Tuning& tuning, std::vector<std::string> laws, const std::string& kept) {
  TuneChoice choice{std::move(laws), {}};
  for (const std::string& name : choice.laws) {
    std::vector<std::string> names;
    for (const TuningLaw& law : tuning.laws) names.push_back(law.name);
    if (std::count(names.begin(), names.end(), name) != 0) continue;
    throw UsageError(fmt::format("--law {}: must be a law of {}: \"{}\"", name, tuning.file,
                                 fmt::join(names, "\", \"")));
  }
  if (kept.empty()) return choice;
  if (tuning.aims.size() > 1) {
    throw UsageError(
        fmt::format("--keep {}: has no effect with two aims in {}", kept, tuning.file));
  }
  const Gains gains = read_gains(kept);
  if (gains.objective != tuning.objective(tuning.aims.front())) {
    throw UsageError(
        fmt::format("--keep {}: was tuned for another objective: {}", kept, gains.objective));
  }
  for (const TuningLaw& law : tuning.laws) {
    if (choice.is_to_be_tuned(law.name)) continue;
    const TunedLaw* found = gains.find(law.name);
    if (found == nullptr || !is_of(*found, tuning, law)) {
      throw UsageError(fmt::format("--keep {}: law \"{}\" of {} is {}: tune it, with --law", kept,
                                   law.name, tuning.file,
                                   found == nullptr ? "not there" : "another there"));
    }
    choice.kept.push_back(*found);
  }
  return choice;
}

std::optional<TuneResult> tune(const Tuning& tuning, const TuneChoice& choice,
                               const std::filesystem::path& folder, std::size_t jobs,
                               const std::string& command) {
  TuneResult result;
  for (const Aim aim : tuning.aims)
    result.gains.push_back({"", command, tuning.objective(aim), {}});
  for (const TuningLaw& law : tuning.laws) {
    if (choice.is_to_be_tuned(law.name)) {
      if (!tune_law(tuning, law, folder / folder_of(law.name), jobs, result)) return std::nullopt;
      continue;
    }
    for (const TunedLaw& kept : choice.kept) {
      if (kept.name == law.name) result.gains.front().laws.push_back(kept);
    }
  }
  mark_front(result.front);
  return result;
}

}  // namespace tether
