#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "netem/link/delay_bins.hpp"
#include "netem/statistics/batch_means.hpp"
#include "netem/statistics/channel_expectation.hpp"
#include "netem/statistics/estimate.hpp"
#include "netem/statistics/loss_record.hpp"

namespace tether {

/// Quantiles of delays with confidence intervals that assume nothing about the delays' law.
///
/// The interval of the quantile q is a pair of order statistics whose ranks are the binomial
/// distribution's (David & Nagaraja, Order Statistics, section 7.1) for the number of *effective*
/// samples; where even the largest delay does not bound it at that level, it has no interval. The
/// effective number of samples is count/VIF, with the VIF of the indicator "delay <= quantile":
/// given by a model, or estimated by batch means (see BatchMeans) at the quantiles of the first
/// kPilot delays.
///
/// Memory is bounded: delays are kept in bins 1/256 of their value wide, with the smallest, the
/// largest and the mean of each bin. A constant delay is reported exactly; intervals are widened to
/// the ends of their bins, so they stay valid.
class DelayStatistics {
 public:
  static constexpr std::array<double, 3> kQuantiles{0.50, 0.90, 0.99};
  static constexpr std::int64_t kPilot = 1024;

  /// The next received packet's delay, in the order of sending. Negative ones count as zero.
  void add(Duration delay);

  std::int64_t count() const { return count_; }
  /// s; NaN without delays.
  double mean_s() const;
  /// s; 0 without delays.
  double shortest_s() const { return static_cast<double>(shortest_ns_) * 1e-9; }
  double longest_s() const { return static_cast<double>(longest_ns_) * 1e-9; }

  /// The quantile q, 0 < q < 1, in seconds.
  Estimate quantile(double q, double confidence, double vif) const;

  /// Variance inflation of kQuantiles[index], estimated from the delays themselves; at least 1. 1
  /// below kPilot delays, and if the delays are constant.
  double estimated_vif(std::size_t index) const;
  /// Whether there are enough delays, against their correlation time, to estimate it.
  bool vif_is_reliable(std::size_t index) const;

 private:
  struct Bin {
    std::int64_t count = 0;
    std::int64_t low_ns = 0, high_ns = 0;
    double sum_ns = 0.0;
  };
  struct Indicator {
    std::int64_t threshold_ns = 0;
    std::int64_t below = 0;  // delays <= threshold
    BatchMeans<1> batches;
  };
  void choose_thresholds();
  void indicate(std::int64_t delay_ns);

  DelayBins<Bin, 9> bins_;
  std::int64_t count_ = 0;
  double sum_ns_ = 0.0;
  std::int64_t shortest_ns_ = 0, longest_ns_ = 0;
  std::vector<std::int64_t> pilot_;
  std::array<Indicator, kQuantiles.size()> indicators_;
};

/// How long a channel stays in each of its states. The time is the caller's, and so is its unit:
/// seconds, or packets for channels that change at every packet.
///
/// Mean = time in the state / departures from it, the maximum-likelihood estimate that uses the
/// sojourns at the beginning and end of the record as well, though neither is complete. The
/// interval is mean_time_interval()'s: exact for exponential sojourns, conservative for geometric
/// ones.
class SojournStatistics {
 public:
  explicit SojournStatistics(std::size_t states) : states_(states) {}

  /// The channel is in `state` from `when` on. Call at the record's beginning and at each change;
  /// calling again without a change does no harm. `when` never goes back.
  void enter(std::size_t state, double when);
  /// The record ends, or is looked at, at `when`.
  void advance(double when);

  std::int64_t departures(std::size_t state) const { return states_[state].departures; }
  double time_in(std::size_t state) const { return states_[state].time; }
  Estimate mean(std::size_t state, double confidence) const;

 private:
  struct State {
    double time = 0.0;
    std::int64_t departures = 0;
  };
  std::vector<State> states_;
  bool begun_ = false;
  std::size_t current_ = 0;
  double since_ = 0.0;
};

enum class Verdict {
  ok,              ///< the configured value lies within an interval narrow enough to mean something
  outside,         ///< it does not lie within the interval: model or program is wrong
  too_short,       ///< it does, but the interval is too wide to mean anything
  not_comparable,  ///< nothing predicts the value, such as of bursts under irregular traffic
};
/// "ok", "outside", "too short", "not comparable".
std::string to_string(Verdict verdict);

/// One quantity of a channel, as configured and as it came out.
struct ChannelCheck {
  std::string quantity;     ///< "PRR", "mean loss burst", "lag-1 correlation", "delay p99", …
  std::string unit;         ///< "", "packets", "s", "ms"
  double configured = 0.0;  ///< NaN: nothing predicts it
  Estimate achieved;        ///< with the interval that is shown; the verdict's own is wider
  Verdict verdict = Verdict::ok;
  std::string reason;  ///< why it is not comparable, or what else to know; often empty
};

struct ChannelCheckOptions {
  /// Confidence of the intervals that are shown.
  double shown_confidence = 0.95;
  /// Probability that a right channel gets any "outside" at all in a report. Shared equally among
  /// its quantities (Bonferroni), so that each interval's level is 1 −
  /// false_alarm/quantities: 99.99 % for ten of them.
  double false_alarm = 1e-3;
  /// "ok" requires an interval whose half-width is at most this share of the configured value (of
  /// the rarer fate's probability for the PRR; of 1 for correlations; for delays of half the
  /// distance from their median to p99 if that is more).
  double precision = 0.25;
  /// With fewer effective samples than this, only the PRR is judged: variances are asymptotic.
  double least_samples = 30.0;
  /// Above this variation of the intervals between packets, bursts and correlation are not
  /// predicted for models in time.
  double most_interval_variation = 0.05;
};

/// Compares. `sojourns` may be null where states cannot be seen; then they are left out, as is
/// every quantity that the model leaves undefined (bursts where nothing is lost).
std::vector<ChannelCheck> compare_channel(const ChannelExpectation& expected,
                                          const LossRecord& loss, const DelayStatistics& delays,
                                          const SojournStatistics* sojourns,
                                          const ChannelCheckOptions& options = {});

/// outside if any is; else too_short if any is; else ok; not_comparable if nothing is comparable.
Verdict overall(const std::vector<ChannelCheck>& checks);

}  // namespace tether
