#pragma once

#include <cstdint>
#include <vector>

namespace tether::test {

/// Do two samples come from one law? Each returns the probability of a difference at least as large
/// as this one if they do.

/// Numbers of events in n trials each, of which the ratio has the standard deviation `ratio_sd` in
/// either sample, normally distributed.
double same_ratio(std::int64_t first, std::int64_t second, std::int64_t n, double ratio_sd);

/// Pearson's chi-square of homogeneity of two histograms.
struct ChiSquare {
  double sum = 0.0;
  int degrees_of_freedom = 0;

  /// `inflation` >= 1: the sum's mean over what it is for independent samples (Rao & Scott, Annals
  /// of Statistics 12(1), 1984).
  double probability(double inflation = 1.0) const;
};

/// Neighbouring classes are pooled until both samples together have `least` in each: with 40,
/// either expects about 20 or more if they are equally large.
ChiSquare same_histogram(const std::vector<std::int64_t>& first,
                         const std::vector<std::int64_t>& second, std::int64_t least = 40);

/// Kolmogorov and Smirnov's largest difference of the empirical distribution functions. The
/// probability is the asymptotic one (Smirnov, Annals of Mathematical Statistics 19(2), 1948):
/// 2 Σ_k (−1)^(k−1) exp(−2 k² λ²), λ² = D² n m/(n + m); with ties it is an upper bound.
struct KolmogorovSmirnov {
  double distance = 0.0;
  double probability = 1.0;
};
KolmogorovSmirnov same_law(std::vector<double> first, std::vector<double> second);

}  // namespace tether::test
