#include "netem/fit/goodness.hpp"

#include <algorithm>
#include <array>
#include <boost/math/distributions/chi_squared.hpp>
#include <cmath>

namespace tether {
namespace {

constexpr std::array<std::size_t, 15> kLags{1,  2,  3,   5,   8,   13,  21, 34,
                                            55, 89, 144, 233, 377, 610, 987};
constexpr std::size_t kExact = 8;     // lengths up to here have a class each
constexpr double kClassRatio = 1.3;   // ratio of successive classes beyond
constexpr std::size_t kClasses = 80;  // up to 8·1.3^72 > 10^9
constexpr std::size_t kFeatures = 3;
using Counts = std::vector<double>;
using Features = std::array<Counts, kFeatures>;  // bursts, gaps, losses k apart

std::size_t class_of(std::size_t length) {
  if (length <= kExact) return length - 1;
  const double beyond = std::log(static_cast<double>(length) / kExact) / std::log(kClassRatio);
  return std::min(kClasses - 1, kExact + static_cast<std::size_t>(beyond));
}

void count_runs(const std::vector<std::uint8_t>& bits, Features& features) {
  std::size_t begin = 0;
  for (std::size_t i = 1; i <= bits.size(); ++i) {
    if (i < bits.size() && bits[i] == bits[begin]) continue;
    // The first and the last run have no known length.
    if (begin > 0 && i < bits.size()) ++features[bits[begin] == 1 ? 0 : 1][class_of(i - begin)];
    begin = i;
  }
}

void count_pairs(const std::vector<std::uint8_t>& bits, Counts& pairs) {
  for (std::size_t l = 0; l < kLags.size(); ++l) {
    std::int64_t both = 0;
    for (std::size_t i = kLags[l]; i < bits.size(); ++i) both += bits[i] & bits[i - kLags[l]];
    pairs[l] += static_cast<double>(both);
  }
}

Features features_of(const FateBits& log) {
  Features f{Counts(kClasses), Counts(kClasses), Counts(kLags.size())};
  for (const auto& segment : log) {
    count_runs(segment, f);
    count_pairs(segment, f[2]);
  }
  return f;
}

/// Adds up the classes of which the model expects too few each.
void pool_rare(const Counts& means, Counts& counts) {
  constexpr double kFewest = 5.0;
  double rare = 0.0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (means[i] >= kFewest) continue;
    rare += counts[i];
    counts[i] = 0.0;
  }
  counts.push_back(rare);
}

struct Moments {
  Counts mean, variance;
};

Moments moments(const std::vector<Counts>& samples) {
  const std::size_t n = samples.front().size();
  const auto count = static_cast<double>(samples.size());
  Moments m{Counts(n), Counts(n)};
  for (const Counts& s : samples) {
    for (std::size_t i = 0; i < n; ++i) m.mean[i] += s[i] / count;
  }
  for (const Counts& s : samples) {
    for (std::size_t i = 0; i < n; ++i) {
      m.variance[i] += (s[i] - m.mean[i]) * (s[i] - m.mean[i]) / (count - 1.0);
    }
  }
  return m;
}

GoodnessOfFit::Part compare(const char* feature, Counts observed, std::vector<Counts> simulated,
                            bool pool) {
  if (pool) {
    const Counts means = moments(simulated).mean;
    pool_rare(means, observed);
    for (Counts& s : simulated) pool_rare(means, s);
  }
  const Moments m = moments(simulated);
  const auto distance = [&m](const Counts& counts) {
    double sum = 0.0;
    for (std::size_t i = 0; i < counts.size(); ++i) {
      // Counts vary by one at least; what no simulation shows still could happen.
      sum += (counts[i] - m.mean[i]) * (counts[i] - m.mean[i]) / std::max(1.0, m.variance[i]);
    }
    return sum;
  };
  std::vector<Counts> distances;
  for (const Counts& s : simulated) distances.push_back({distance(s)});
  const Moments null = moments(distances);
  GoodnessOfFit::Part part{feature, distance(observed), null.mean[0], 1.0};
  if (null.mean[0] > 0.0 && null.variance[0] > 0.0) {
    const double scale = null.variance[0] / (2.0 * null.mean[0]);
    const boost::math::chi_squared law(null.mean[0] / scale);
    part.p_value = boost::math::cdf(boost::math::complement(law, part.statistic / scale));
  }
  return part;
}

}  // namespace

bool GoodnessOfFit::fits() const {
  return std::all_of(parts.begin(), parts.end(), [](const Part& p) {
    return p.p_value >= kFalseAlarm / static_cast<double>(kFeatures);
  });
}

GoodnessOfFit goodness_of_fit(const FateBits& observed,
                              const std::function<FateBits(RandomEngine&)>& simulate,
                              RandomEngine random) {
  constexpr std::size_t kPackets = 20'000'000;
  std::size_t packets = 1;
  for (const auto& segment : observed) packets += segment.size();
  GoodnessOfFit result;
  result.simulations = static_cast<int>(std::clamp<std::size_t>(kPackets / packets, 60, 200));
  std::array<std::vector<Counts>, kFeatures> simulated;
  for (int k = 0; k < result.simulations; ++k) {
    const Features f = features_of(simulate(random));
    for (std::size_t i = 0; i < kFeatures; ++i) simulated[i].push_back(f[i]);
  }
  const Features seen = features_of(observed);
  result.parts.push_back(compare("lengths of loss bursts", seen[0], simulated[0], true));
  result.parts.push_back(compare("lengths of gaps between bursts", seen[1], simulated[1], true));
  result.parts.push_back(compare("losses k packets apart", seen[2], simulated[2], false));
  return result;
}

}  // namespace tether
