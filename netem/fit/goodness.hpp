#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/base/random.hpp"

namespace tether {

/// Fates (1 = lost) of consecutive packets, one vector per segment.
using FateBits = std::vector<std::vector<std::uint8_t>>;

/// Whether a model could have made what was observed.
///
/// Three features are compared with 60 to 200 simulated logs of the model, as many as 2·10⁷ packets
/// allow. Two are how many loss bursts, and how many gaps between them, have each length. Lengths
/// are in classes; those that the model expects fewer than five of are pooled. The third is how
/// often packets k apart are both lost (k = 1, 2, 3, 5, 8 … 987). Statistic: Σ (observed −
/// mean)²/variance, mean and variance over the simulated logs, which accounts for the dependence of
/// bursts on each other as Pearson's chi-square would not. Its law under the model is taken for a
/// scaled chi-square with the mean and variance that the simulated logs show (Satterthwaite,
/// Biometrics Bulletin 2(6), 1946). That the model's parameters were fitted to the same log makes
/// the test conservative.
struct GoodnessOfFit {
  struct Part {
    std::string feature;
    double statistic = 0.0;
    double expected = 0.0;  ///< its mean under the model
    double p_value = 1.0;
  };
  std::vector<Part> parts;
  int simulations = 0;

  /// Probability that a right model is called wrong, all parts together.
  static constexpr double kFalseAlarm = 1e-3;
  bool fits() const;
};

/// `simulate` draws a log of the same size from the model.
GoodnessOfFit goodness_of_fit(const FateBits& observed,
                              const std::function<FateBits(RandomEngine&)>& simulate,
                              RandomEngine random);

}  // namespace tether
