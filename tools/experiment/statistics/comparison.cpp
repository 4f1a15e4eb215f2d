#include "tools/experiment/statistics/comparison.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "common/base/random.hpp"
#include "tools/experiment/statistics/random_index.hpp"

namespace tether {
namespace {

using Column = std::vector<double>;                   // values by ascending seed
constexpr std::size_t kSimultaneousResamples = 5000;  // many pairs need the tails of each
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
    double largest = 0.0;
    for (std::size_t i = 0; i < first.size(); ++i) {
      differences_[i] = first[i] - second[i];
      largest = std::max({largest, std::abs(first[i]), std::abs(second[i])});
    }
    constexpr double kRounding = 1e-12;
    const auto [low, high] = std::minmax_element(differences_.begin(), differences_.end());
    constant_ = *high - *low <= kRounding * largest;
    std::vector<std::size_t> all(first.size());
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
    measured_ = of(all);
  }

  // The difference is the same in each seed: nothing to resample.
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

// Bounds of |t| for all pairs simultaneously, at the confidence.
std::vector<double> critical_deviations(const std::vector<Pair>& pairs, std::size_t n,
                                        double confidence, std::uint64_t seed) {
  RandomEngine random = random_stream(seed, "bootstrap/best");
  std::vector<std::size_t> rows(n);
  std::vector<Column> drawn(pairs.size(), Column(kSimultaneousResamples));
  for (std::size_t sample = 0; sample < kSimultaneousResamples; ++sample) {
    for (std::size_t& row : rows) row = random_index(random, n);
    for (std::size_t p = 0; p < pairs.size(); ++p) drawn[p][sample] = pairs[p].deviation(rows);
  }
  // The rank of a sample among those of its pair, the largest over the pairs: a pair whose law is
  // wild has ranks like any other. Equal ones, also infinite, share the lowest.
  std::vector<std::size_t> highest(kSimultaneousResamples, 0);
  std::vector<Column> sorted = drawn;
  for (std::size_t p = 0; p < pairs.size(); ++p) {
    std::sort(sorted[p].begin(), sorted[p].end());
    for (std::size_t sample = 0; sample < kSimultaneousResamples; ++sample) {
      const auto below = std::lower_bound(sorted[p].begin(), sorted[p].end(), drawn[p][sample]);
      const auto rank = static_cast<std::size_t>(below - sorted[p].begin());
      highest[sample] = std::max(highest[sample], rank);
    }
  }
  std::sort(highest.begin(), highest.end());
  const auto order = static_cast<std::size_t>(
      std::ceil(confidence * static_cast<double>(kSimultaneousResamples + 1)));
  const std::size_t rank = highest[std::min(order, kSimultaneousResamples) - 1];
  std::vector<double> critical;
  for (const Column& deviations : sorted) critical.push_back(deviations[rank]);
  return critical;
}

// How far each arm's mean lies above the best's, and how uncertain that is at once with all pairs.
struct Comparisons {
  std::vector<Difference> to_best;
  std::vector<double> margins;
};

Comparisons compare_with_best(const std::vector<Column>& columns, std::size_t best,
                              double confidence, std::uint64_t seed) {
  std::vector<Pair> pairs;
  std::vector<std::size_t> with_best(columns.size());  // place among the pairs
  Comparisons result{std::vector<Difference>(columns.size()),
                     std::vector<double>(columns.size(), 0.0)};
  for (std::size_t i = 0; i < columns.size(); ++i) {
    for (std::size_t j = i + 1; j < columns.size(); ++j) {
      Pair pair = j == best ? Pair(columns[i], columns[j]) : Pair(columns[j], columns[i]);
      const std::size_t other = j == best ? i : j;
      const bool has_best = i == best || j == best;
      if (has_best) result.to_best[other] = pair.measured();
      if (pair.constant()) continue;
      if (has_best) {
        with_best[other] = pairs.size();
        result.margins[other] = pair.measured().error;
      }
      pairs.push_back(std::move(pair));
    }
  }
  if (pairs.empty()) return result;
  const auto critical = critical_deviations(pairs, columns.front().size(), confidence, seed);
  for (std::size_t arm = 0; arm < columns.size(); ++arm) {
    if (result.margins[arm] > 0.0) result.margins[arm] *= critical[with_best[arm]];
  }
  return result;
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

MeanRatio mean_ratio(const std::vector<SeededValue>& first, const std::vector<SeededValue>& second,
                     double confidence, std::uint64_t seed) {
  const Common common = common_seeds({&first, &second});
  const Column &x = common.columns[0], &y = common.columns[1];
  MeanRatio result;
  result.left_out = common.left_out;
  result.first = summarize(x, confidence, seed);
  result.second = summarize(y, confidence, seed);
  if (x.empty()) return result;
  result.ratio = result.first.mean / result.second.mean;
  if (result.first.sd == 0.0 && result.second.sd == 0.0) {  // no randomness in it
    result.interval = {result.ratio, result.ratio};
    return result;
  }
  RandomEngine random = random_stream(seed, "bootstrap/ratio");
  Column resampled(kResamples), without_one(x.size());
  for (double& ratio : resampled) {
    double x_sum = 0.0, y_sum = 0.0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const std::size_t row = random_index(random, x.size());
      x_sum += x[row];
      y_sum += y[row];
    }
    ratio = x_sum / y_sum;
  }
  const auto n = static_cast<double>(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) {
    without_one[i] = (n * result.first.mean - x[i]) / (n * result.second.mean - y[i]);
  }
  result.interval = bca_interval(result.ratio, std::move(resampled), without_one, confidence);
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
  std::size_t best = 0;  // index of the best participating arm
  for (std::size_t i = 0; i < taking_part.size(); ++i) {
    result.means[taking_part[i]] = mean_by_seed(common.columns[i]);
    if (result.means[taking_part[i]] < result.means[taking_part[best]]) best = i;
  }
  result.best = taking_part[best];
  if (result.n < kLeastPairs) {
    for (const std::size_t arm : taking_part) result.tied[arm] = true;
    return result;
  }
  const Comparisons compared = compare_with_best(common.columns, best, confidence, seed);
  for (std::size_t i = 0; i < taking_part.size(); ++i) {
    const std::size_t arm = taking_part[i];
    const double mean = compared.to_best[i].mean, margin = compared.margins[i];
    result.tied[arm] = mean <= margin;
    if (i != best && std::isfinite(margin)) {
      result.differences[arm] = {mean - margin, mean + margin};
    }
  }
  return result;
}

}  // namespace tether
