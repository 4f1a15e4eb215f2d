#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "netem/fit/data.hpp"
#include "netem/models/gilbert_elliott.hpp"

namespace tether {

/// A log of fates as runs of equal fates, by which a likelihood costs O(runs) instead of
/// O(packets).
class RunLog {
 public:
  explicit RunLog(const FateLog& log);

  struct Run {
    bool lost = false;
    std::uint32_t length_index = 0;  ///< into lengths(lost)
  };
  const std::vector<std::vector<Run>>& segments() const { return segments_; }
  /// The distinct lengths of runs of that fate.
  const std::vector<std::int64_t>& lengths(bool lost) const { return lengths_[lost ? 1 : 0]; }

 private:
  std::vector<std::vector<Run>> segments_;
  std::array<std::vector<std::int64_t>, 2> lengths_;
};

/// ln P[fates | model] of the Gilbert–Elliott model, each segment beginning in the stationary
/// distribution: the forward algorithm (Rabiner, Proc. IEEE 77(2), 1989, section III.A) with the
/// step matrices of whole runs. −infinity for fates that the model cannot produce.
double log_likelihood(const RunLog& log, const GilbertElliott& model);

/// A two-state Markov process in continuous time, with a reception ratio for each state.
struct MarkovModel {
  double prr_good = 1.0;
  double prr_bad = 0.5;
  double mean_good_s = 1.0;
  double mean_bad_s = 1.0;
};

/// The chain that packets sent every `interval_s` meet.
GilbertElliott sampled(const MarkovModel& model, double interval_s);

/// ln P[fates at their times | model]; O(packets).
double log_likelihood(const FateLog& log, const MarkovModel& model);

/// P[state bad at packet | all fates of its segment], in the order of the log, by the
/// forward-backward algorithm.
std::vector<double> bad_state_posterior(const FateLog& log, const MarkovModel& model);

}  // namespace tether
