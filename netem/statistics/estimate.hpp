#pragma once

#include <limits>

namespace tether {

/// A quantity as measured, with the confidence interval [low, high].
struct Estimate {
  double value = std::numeric_limits<double>::quiet_NaN();  ///< NaN: nothing to measure it from
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
  /// How many independent samples the correlated ones are worth.
  double effective_samples = 0.0;
};

/// z with P[|Z| <= z] = confidence for a standard normal Z.
double normal_quantile(double confidence);
/// The same for Student's t distribution.
double student_quantile(double confidence, double degrees_of_freedom);

/// The interval of Clopper and Pearson (1934) for a probability. Numbers need not be whole: with
/// `trials` = effective samples and `successes` = share × trials it is the interval of Korn and
/// Graubard (Survey Methodology 24, 1998) for correlated samples, which stays sensible where
/// successes are rare or none.
Estimate proportion_interval(double successes, double trials, double confidence);

/// The interval for the mean time between events that occur at a constant rate: `events` of them
/// within `exposure` (the time at risk). Chi-square with 2·events and 2·events + 2 degrees of
/// freedom, conservative for observation that ends at a set time (Epstein & Sobel, JASA 48, 1953).
/// Without events only the lower bound is finite.
Estimate mean_time_interval(double events, double exposure, double confidence);

}  // namespace tether
