#pragma once

#include <boost/random/normal_distribution.hpp>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/base/random.hpp"

namespace tether::test {

/// exp of a standard normal.
struct LogNormal {
  double mean() const { return std::exp(0.5); }
  double operator()(RandomEngine& random) const {
    return std::exp(boost::random::normal_distribution<double>()(random));
  }
};

/// Four runs in five follow the path to about 2 m, one is lost at about 22 m.
struct EightyTwenty {
  double mean() const { return 0.8 * 2.0 + 0.2 * 22.0; }
  double operator()(RandomEngine& random) const {
    const bool lost = uniform_01(random) < 0.2;
    boost::random::normal_distribution<double> around(lost ? 22.0 : 2.0, lost ? 1.0 : 0.3);
    return around(random);
  }
};

/// Effect of PRR 0.85 on the paper's vehicle: 3.7 % are lost at about 22 m, the others are well.
struct RarelyLost {
  static constexpr double kLost = 0.037, kSurvivors_m = 1.9;

  double mean() const { return (1.0 - kLost) * kSurvivors_m + kLost * 22.0; }
  double operator()(RandomEngine& random) const {
    const bool lost = uniform_01(random) < kLost;
    boost::random::normal_distribution<double> around(lost ? 22.0 : kSurvivors_m, lost ? 1.0 : 0.1);
    return around(random);
  }
};

template <typename Law>
std::vector<double> sample(const Law& law, std::size_t n, RandomEngine& random) {
  std::vector<double> values(n);
  for (double& value : values) value = law(random);
  return values;
}

/// Standard deviation of a share that is measured in `trials`.
inline double share_sd(double share, int trials) {
  return std::sqrt(share * (1.0 - share) / trials);
}

}  // namespace tether::test
