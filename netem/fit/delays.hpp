#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "netem/fit/parameter.hpp"

namespace tether {

/// Delays [s] of a log's packets in the order of sending, a vector for each segment; NaN for a
/// packet that was lost or of which the delay is not known.
using DelayLog = std::vector<std::vector<double>>;

/// Law that delays follow: a constant and a law of [channel.….jitter] (netem/stages/delay_law.hpp),
/// with the correlation of successive packets' normal scores.
///
/// - Correlation: that of the normal scores of ranks, over neighbours that both arrived; 0 unless
///   kSignificant standard errors from it. n delays then are worth n_eff = n (1 − c)/(1 + c) ones.
/// - Laws: normal, uniform, gamma, lognormal and Pareto by maximum likelihood, the last three from
/// a
///   lower end that is estimated too. Delays count as independent in it, and the likelihood for
///   n_eff/n of what it is; BIC chooses.
/// - Whether it fits: Kolmogorov's distance, with n_eff (conservative for estimated laws, and for
///   correlated delays approximate). If no law does (p below kFalseAlarm), `law` is "table", 101
///   quantiles as they were; the tail beyond the last one but one is even there.
struct DelayFit {
  static constexpr std::int64_t kFewest = 100;  ///< fewer: a constant
  static constexpr double kSignificant = 4.0;
  static constexpr double kFalseAlarm = 1e-3;

  struct Candidate {
    std::string law;
    double constant_s = 0.0;  ///< constant part, to which the law is added
    double mean_s = 0.0, sd_s = 0.0, shape = 3.0;
    double bic = 0.0;
    double distance = 0.0;  ///< Kolmogorov's
    double p_value = 1.0;
    std::vector<FitParameter> parameters;  ///< parameters of the scenario, in ms
  };

  std::int64_t delays = 0;
  double mean_s = 0.0;
  double effective = 0.0;             ///< n_eff
  std::vector<Candidate> candidates;  ///< empty: too few, or all the same
  std::size_t best = 0;
  std::vector<double> table_s;  ///< if none fits
  double correlation = 0.0, correlation_error = 0.0;
  /// Correlation of scores kFar packets apart, observed and by the correlation; error of the
  /// former.
  static constexpr int kFar = 10;
  double far = 0.0, far_expected = 0.0, far_error = 0.0;

  std::string law() const;  ///< "none" without candidates
  /// True if delays stay correlated for longer than jitter.correlation can express.
  bool lasts_longer() const { return far - far_expected > kSignificant * far_error; }
};

/// `lowest_s`: the lower end of a law is not sought below.
DelayFit fit_delays(const DelayLog& log, double lowest_s = 0.0);

/// Normal scores of the ranks of all delays that are known, in the order of sending.
std::vector<double> delay_scores(const DelayLog& log);

}  // namespace tether
