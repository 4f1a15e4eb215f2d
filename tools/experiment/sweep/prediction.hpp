#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "tools/experiment/statistics/statistics.hpp"
#include "tools/experiment/sweep/run_store.hpp"

namespace tether {

/// Prediction for new runs of one setting, from simulated ones: how many vehicles are lost, and the
/// interval in which the metric of a vehicle lies that is not lost.
///
/// The interval lies between two order statistics of n values: rank `beyond` from below and from
/// above. A new value of the same distribution, whatever that is, lies within with probability
/// 1 − 2·beyond/(n + 1) (Wilks, Annals of Mathematical Statistics 12, 1941). `beyond` is the
/// largest for which that is kPredicted or more, and at least 1: below 39 runs the probability is
/// smaller.
struct PredictedArm {
  std::vector<KeyValue> settings;
  std::size_t runs = 0;  ///< runs that did not fail
  std::size_t lost = 0;
  std::size_t values = 0;  ///< n: of vehicles that were not lost, finite
  std::size_t beyond = 1;
  Interval interval;  ///< none below two values

  double coverage() const;
  bool operator==(const PredictedArm& other) const;
};
inline constexpr double kPredicted = 0.95;

/// A prediction as a file holds it: from what it was computed, and what it says. Two of the same
/// runs are equal, byte for byte.
struct Prediction {
  std::string name;     ///< the experiment's
  std::string version;  ///< the simulating program's
  std::string plant;
  std::string scenarios;  ///< BLAKE2b-256 of all resolved scenarios
  std::string metric;
  double tolerance = 0.0;  ///< so far beyond an interval counts as within, in the metric's unit
  std::vector<std::uint64_t> seeds;  ///< seeds of all arms, ascending, each once
  std::vector<PredictedArm> arms;

  bool operator==(const Prediction&) const = default;
};

/// From a sweep's runs. `metric`: as SweepData takes it. `tolerance`: 0 or more; without any, a
/// setting in which nothing is random allows one value. Throws UsageError if the sweep is not
/// complete.
Prediction predict(const RunStore& store, const std::string& metric, double tolerance = 0.0);

/// The file's text, JSON with a member "digest": BLAKE2b-256 of all others, in hexadecimal digits.
/// A digest that was written down before a measurement shows later that nothing has changed.
std::string to_json(const Prediction& prediction);
std::string digest_of(const Prediction& prediction);
/// Reads such a file. Throws UsageError that names file and member for anything else, and if the
/// digest is not that of the contents.
Prediction read_prediction(const std::string& file);

/// Measured runs of one setting.
struct MeasuredArm {
  std::vector<KeyValue> settings;
  std::size_t runs = 0;
  std::size_t lost = 0;
  std::vector<double> values;  ///< values of vehicles that were not lost
};

/// Runs of another sweep, such as with another plant, live, or with other seeds. Throws UsageError
/// if it has runs of the prediction itself: the same version, plant and any seed of it.
std::vector<MeasuredArm> measured_in(const RunStore& store, const Prediction& prediction);

/// A table: a column for each key of the prediction's settings, one named as the metric, and, if
/// vehicles may be lost, `lost` (0 or 1; the metric's cell may then be empty); a row for each run;
/// other columns are left out. Throws UsageError that names file, line and column.
std::vector<MeasuredArm> measured_in_table(const std::string& file, const Prediction& prediction);

/// How a prediction and a measurement of one setting agree.
struct CheckedArm {
  const PredictedArm* predicted = nullptr;
  std::size_t runs = 0;    ///< measured
  std::size_t lost = 0;    ///< lost ones among them
  std::size_t values = 0;  ///< values of the others
  std::size_t within = 0;  ///< the predicted interval
  /// Probability of so few within, or fewer, if the prediction is right: the number within is
  /// beta-binomial, because the interval itself is made of n values. 1 without values.
  double p_within = 1.0;
  /// Fisher's exact test, two-sided, of the shares lost.
  double p_lost = 1.0;
  bool within_holds = true;  ///< after Holm's correction over all tests of the comparison
  bool lost_holds = true;
};
inline constexpr double kFalseAlarms = 0.05;

/// Each predicted setting that was measured, in the prediction's order. The probability that a
/// right prediction does not hold in all is kFalseAlarms at most (Holm, Scandinavian Journal of
/// Statistics 6, 1979). Throws UsageError if a measured setting was not predicted, or none was
/// measured.
std::vector<CheckedArm> check_prediction(const Prediction& prediction,
                                         const std::vector<MeasuredArm>& measured);

/// P[K ≤ k] of how many of m new values lie within an interval that n values left `beyond` of on
/// each side.
double probability_of_so_few_within(std::size_t k, std::size_t m, std::size_t n,
                                    std::size_t beyond);
/// Returns the two-sided p-value of the table {{a, n − a}, {b, m − b}}.
double fisher_exact(std::size_t a, std::size_t n, std::size_t b, std::size_t m);
/// Which hypotheses stay, in the order given: Holm's step-down procedure.
std::vector<bool> not_rejected_by_holm(const std::vector<double>& p_values, double level);

}  // namespace tether
