#include "tools/experiment/comparison.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <map>
#include <set>

#include "common/random.hpp"
#include "tools/experiment/random_index.hpp"

namespace tether {
namespace {

using Column = std::vector<double>;  // values by ascending seed
using ValueBySeed = std::map<std::uint64_t, double>;

ValueBySeed finite_values(const std::vector<SeededValue>& runs) {
  ValueBySeed arm;
  for (const SeededValue& run : runs) {
    const bool is_new = arm.emplace(run.seed, run.value).second;
    assert(is_new);
    static_cast<void>(is_new);
  }
  std::erase_if(arm, [](const auto& entry) { return !std::isfinite(entry.second); });
  return arm;
}

struct Common {
  std::vector<Column> columns;
  std::size_t left_out = 0;
};

// All seeds that were run in any arm are counted, also those which failed.
Common common_seeds(const std::vector<const std::vector<SeededValue>*>& arms) {
  std::set<std::uint64_t> seeds;
  std::vector<ValueBySeed> finite;
  for (const auto* runs : arms) {
    finite.push_back(finite_values(*runs));
    for (const SeededValue& run : *runs) seeds.insert(run.seed);
  }
  Common common;
  common.columns.resize(arms.size());
  for (const std::uint64_t seed : seeds) {
    const auto has_seed = [seed](const ValueBySeed& arm) { return arm.contains(seed); };
    if (!std::all_of(finite.begin(), finite.end(), has_seed)) {
      ++common.left_out;
      continue;
    }
    for (std::size_t i = 0; i < arms.size(); ++i) common.columns[i].push_back(finite[i].at(seed));
  }
  return common;
}

// The difference of two arms' means, with its standard error.
struct Difference {
  double mean = 0.0;
  double error = 0.0;
};

class Pair {
 public:
  Pair(const Column& first, const Column& second) : differences_(first.size()) {
    for (std::size_t i = 0; i < first.size(); ++i) differences_[i] = first[i] - second[i];
    const auto [low, high] = std::minmax_element(differences_.begin(), differences_.end());
    constant_ = *low == *high;
    std::vector<std::size_t> all(first.size());
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
    measured_ = of(all);
  }

  // Differs by the same in each seed: nothing to resample.
  bool constant() const { return constant_; }
  const Difference& measured() const { return measured_; }

  // |t| of resampled seeds around what was measured; infinite where they have no spread.
  double deviation(const std::vector<std::size_t>& rows) const {
    const Difference d = of(rows);
    const double distance = std::abs(d.mean - measured_.mean);
    return distance > 0.0 ? distance / d.error : 0.0;
  }

 private:
  Difference of(const std::vector<std::size_t>& rows) const {
    const auto n = static_cast<double>(rows.size());
    double sum = 0.0;
    bool equal = true;
    for (const std::size_t row : rows) {
      sum += differences_[row];
      equal = equal && differences_[row] == differences_[rows.front()];
    }
    if (equal) return {differences_[rows.front()], 0.0};
    double squares = 0.0;
    for (const std::size_t row : rows) {
      const double deviation = differences_[row] - sum / n;
      squares += deviation * deviation;
    }
    return {sum / n, std::sqrt(squares / (n * (n - 1.0)))};
  }

  Column differences_;
  Difference measured_;
  bool constant_ = false;
};

// What |t| of all pairs at once stays below with the confidence.
double critical_deviation(const std::vector<Column>& columns, double confidence,
                          std::uint64_t seed) {
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      Pair pair(columns[i], columns[j]);
      if (!pair.constant()) pairs.push_back(std::move(pair));
    }
  }
  const std::size_t n = columns.front().size();
  RandomEngine random = random_stream(seed, "bootstrap/best");
  std::vector<std::size_t> rows(n);
  std::vector<double> largest(kResamples, 0.0);
  for (double& deviation : largest) {
    for (std::size_t& row : rows) row = random_index(random, n);
    for (const Pair& pair : pairs) deviation = std::max(deviation, pair.deviation(rows));
  }
  std::sort(largest.begin(), largest.end());
  // An order statistic, on the safe side: some may be infinite.
  const auto rank = static_cast<std::size_t>(std::ceil(confidence * (kResamples + 1)));
  return largest[std::min<std::size_t>(rank, kResamples) - 1];
}

double mean_by_seed(const Column& column) {
  double sum = 0.0;
  for (const double value : column) sum += value;
  return sum / static_cast<double>(column.size());
}

}  // namespace

PairedDifference paired_difference(const std::vector<SeededValue>& first,
                                   const std::vector<SeededValue>& second, double confidence,
                                   std::uint64_t seed) {
  const Common common = common_seeds({&first, &second});
  Column differences;
  for (std::size_t i = 0; i < common.columns[0].size(); ++i) {
    differences.push_back(common.columns[0][i] - common.columns[1][i]);
  }
  PairedDifference result;
  result.difference = summarize(differences, confidence, seed);
  result.left_out = common.left_out;
  const Interval& interval = result.difference.mean_interval;
  result.separated = differences.size() >= kLeastPairs && !contains(interval, 0.0);
  return result;
}

BestArm ties_of_best(const std::vector<std::vector<SeededValue>>& arms, double confidence,
                     std::uint64_t seed) {
  assert(confidence > 0.0 && confidence < 1.0);
  BestArm result;
  result.tied.assign(arms.size(), false);
  result.means.assign(arms.size(), std::numeric_limits<double>::quiet_NaN());
  result.differences.resize(arms.size());
  std::vector<std::size_t> taking_part;
  std::vector<const std::vector<SeededValue>*> runs;
  for (std::size_t i = 0; i < arms.size(); ++i) {
    if (finite_values(arms[i]).empty()) continue;
    taking_part.push_back(i);
    runs.push_back(&arms[i]);
  }
  const Common common = common_seeds(runs);
  result.left_out = common.left_out;
  if (runs.empty() || common.columns.front().empty()) return result;

  result.n = common.columns.front().size();
  std::size_t best = 0;  // of those that take part
  for (std::size_t i = 0; i < taking_part.size(); ++i) {
    result.means[taking_part[i]] = mean_by_seed(common.columns[i]);
    if (result.means[taking_part[i]] < result.means[taking_part[best]]) best = i;
  }
  result.best = taking_part[best];
  const bool decidable = result.n >= kLeastPairs;
  const double critical = decidable ? critical_deviation(common.columns, confidence, seed) : 0.0;
  for (std::size_t i = 0; i < taking_part.size(); ++i) {
    const std::size_t arm = taking_part[i];
    if (i == best || !decidable) {
      result.tied[arm] = true;
      continue;
    }
    const Pair pair(common.columns[i], common.columns[best]);
    const double margin = pair.constant() ? 0.0 : critical * pair.measured().error;
    result.tied[arm] = pair.measured().mean <= margin;
    if (std::isfinite(margin)) {
      result.differences[arm] = {pair.measured().mean - margin, pair.measured().mean + margin};
    }
  }
  return result;
}

}  // namespace tether
