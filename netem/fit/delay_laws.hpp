#pragma once

#include <string>
#include <vector>

namespace tether {

/// A law of delays as maximum likelihood finds it, for DelayFit.
struct FittedLaw {
  std::string name;
  double lower_end = 0.0;  ///< origin of the mean; 0 for normal and uniform
  double mean = 0.0, sd = 0.0, shape = 3.0;
  /// Standard errors of lower end, mean, standard deviation and shape, of independent values; NaN:
  /// not determined, or the law does not have this parameter. For the lower end, 0 means: it is at
  /// a limit of where it is sought.
  double errors[4] = {};
  int free_parameters = 0;
  double log_likelihood = 0.0;  ///< for one value on average

  double cdf(double x) const;
};

/// Fits each law to `sorted` values, ascending and not all the same; lower ends are not sought
/// below `lowest`. Of more than 20 000 values as many quantiles stand for all.
std::vector<FittedLaw> fit_laws(const std::vector<double>& sorted, double lowest);

}  // namespace tether
