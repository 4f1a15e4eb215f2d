#pragma once

#include <string>

namespace tether {

/// An estimated parameter.
struct FitParameter {
  std::string name;
  double value = 0.0;
  /// By the observed information on the scale of logits (probabilities) or logarithms (times);
  /// NaN where the log does not determine the parameter.
  double standard_error = 0.0;
  double low = 0.0, high = 0.0;  ///< 95 % confidence interval, computed on that scale
  bool fixed = false;            ///< by the choice of model, not estimated
};

}  // namespace tether
