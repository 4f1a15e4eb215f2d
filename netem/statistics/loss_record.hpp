#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "common/base/time.hpp"
#include "netem/statistics/batch_means.hpp"
#include "netem/statistics/estimate.hpp"

namespace tether {

/// How much the correlation of losses widens confidence intervals: variance inflation factors, the
/// ratio of an estimate's variance to what it would be were the samples independent. They come from
/// a model (ChannelExpectation), or from the packets themselves (LossRecord::estimated_spread).
struct LossSpread {
  double vif = 1.0;  ///< VIF of the share of lost packets
  /// VIF of the share of lost packets whose next packet is lost, too.
  double burst_vif = 1.0;
  /// VIF of the share of the rarer fate's packets that the same fate follows.
  double lag1_vif = 1.0;
  /// Correlation of the estimates of that share and of the rarer fate's probability; -1..1.
  double lag1_with_share = 0.0;
  /// Degrees of freedom of these variances: infinite if known, else intervals use Student's t.
  double degrees_of_freedom = std::numeric_limits<double>::infinity();
  /// False if the sequence is too short, against its correlation time, to estimate its spread.
  bool reliable = true;
};

/// The spread of a channel with loss probability `p` and probability `p2` of two losses in a row,
/// of whose estimates over n packets `var_p`, `var_p2` and `cov` are n times the variances and the
/// covariance. Delta method:
/// - Mean loss burst = 1/(1 − c) with c = p2/p, a share of the n·p lost packets;
///   burst_vif = n·Var(ĉ)·p/(c(1 − c)).
/// - Lag-1 correlation = (p2 − p²)/(p(1 − p)) = (k − a)/(1 − a), where a is the probability of the
///   rarer fate (lost or received) and k that it is followed by itself, a share of n·a packets;
///   lag1_vif = n·Var(k̂)·a/(k(1 − k)).
/// Written as shares they get intervals that hold for few events, too. A share of 0 or 1, to 1e-9,
/// leaves nothing to chance; its factor is 1.
LossSpread loss_spread(double p, double p2, double var_p, double cov, double var_p2);

/// Losses in a sequence of packets: packet reception ratio, loss bursts and their lengths, and
/// the correlation of successive fates. O(1) per packet, bounded memory.
class LossRecord {
 public:
  /// Longer bursts share the histogram's last element.
  static constexpr std::size_t kLongestBurst = 4096;

  /// The next packet, in the order of sending.
  void add(bool lost, Instant sent);

  std::int64_t packets() const { return packets_; }
  std::int64_t lost() const { return lost_; }
  /// Runs of lost packets; one that is under way counts.
  std::int64_t bursts() const { return bursts_; }
  std::int64_t longest_burst() const { return longest_burst_; }
  /// [k] = complete bursts of k packets, k >= 1; as long as the longest one.
  const std::vector<std::int64_t>& burst_histogram() const { return burst_histogram_; }

  /// Mean time between packets, s; 0 below two packets.
  double mean_interval_s() const { return interval_mean_s_; }
  /// Standard deviation of these times over their mean: 0 for a periodic sender. Models in time
  /// predict bursts and correlation in packets only for (nearly) periodic ones.
  double interval_variation() const;

  // Each takes the confidence level, 0..1, and the spread that its interval accounts for: Korn and
  // Graubard's, see proportion_interval().

  /// Packet reception ratio.
  Estimate prr(double confidence, const LossSpread& spread) const;
  /// Mean number of packets in a loss burst: lost/bursts.
  Estimate mean_burst(double confidence, const LossSpread& spread) const;
  /// Correlation of successive packets' losses; no value if all or none are lost. The intervals of
  /// k and a, see loss_spread(), are combined by the method of variance estimates recovery (Donner
  /// & Zou, Statistical Methods in Medical Research 21, 2012), which holds where k is 0 or 1, too.
  Estimate lag1_correlation(double confidence, const LossSpread& spread) const;

  /// The spread as the packets themselves show it (batch means, see BatchMeans, and the delta
  /// method), for channels of which no model is known.
  LossSpread estimated_spread() const;

 private:
  static Estimate share(double share, double trials, double confidence, double vif,
                        double degrees_of_freedom);

  std::int64_t packets_ = 0;
  std::int64_t lost_ = 0;
  std::int64_t bursts_ = 0;
  std::int64_t current_burst_ = 0;
  std::int64_t longest_burst_ = 0;
  std::vector<std::int64_t> burst_histogram_;
  BatchMeans<2> batches_;  // (lost, lost after a lost one)
  bool begins_lost_ = false;
  Instant last_sent_;
  double interval_mean_s_ = 0.0, interval_squares_ = 0.0;  // Welford's
};

}  // namespace tether
