#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "netem/statistics/loss_record.hpp"

namespace tether {

using Matrix = std::vector<std::vector<double>>;

/// Long-run share of time (or steps) in each state, from rates or probabilities of going from row
/// to column; the diagonal is not looked at. nullopt if it depends on where the chain begins: there
/// is more than one set of states that is never left. Subtraction-free elimination, so that small
/// probabilities keep their relative accuracy (Grassmann, Taksar, Heyman, Operations Research
/// 33(5), 1985).
std::optional<std::vector<double>> stationary_distribution(const Matrix& moves);

/// P[delay <= delay_s] of a received packet.
using DelayCdf = std::function<double(double delay_s)>;

/// Always the same delay.
DelayCdf constant_delay(double delay_s);

/// Behaviour of a channel in one of its states.
struct ExpectedState {
  std::string name;
  double prr = 1.0;
  DelayCdf delay = constant_delay(0.0);
};

/// Expected statistics of the packets of a channel model. Every model that is a Markov
/// chain when looked at packet by packet, with a loss probability and a delay law for each state:
/// independent losses, Gilbert–Elliott, the four-state model, chains, and Markov processes in time
/// under a periodic sender.
///
/// With stationary distribution π, transition matrix M and loss probabilities e_s = 1 − prr_s:
/// P = Σπe, P₂ = Σ π_s e_s M_st e_t, mean loss burst P/(P − P₂), lag-1 correlation
/// (P₂ − P²)/(P(1 − P)). Whether a packet meets the state before or after its transition
/// (sch_netem.c: gemodel before, loss state after) changes none of them.
class ChannelExpectation {
 public:
  /// Unit of mean sojourn times.
  enum class Unit { packets, seconds };

  /// One state, no memory.
  static ChannelExpectation independent(double prr, DelayCdf delay = constant_delay(0.0));

  /// Any chain that steps once a packet. Throws UsageError if a row does not sum to 1 (to 1e-9), or
  /// if the chain has no unique stationary distribution.
  static ChannelExpectation chain(const Matrix& transition, std::vector<ExpectedState> states);

  /// The same of states that change with time, with their mean sojourn times.
  static ChannelExpectation in_time(const Matrix& transition, std::vector<ExpectedState> states,
                                    std::vector<double> mean_sojourns_s);

  /// Any Markov process in continuous time, seen every `interval_s`: `rates` has the rate (1/s) of
  /// each transition off the diagonal; the diagonal is ignored. M = exp(Q·Δ).
  static ChannelExpectation process(const Matrix& rates, double interval_s,
                                    std::vector<ExpectedState> states);

  /// A chain that steps at the multiples of `step_s`, seen every `interval_s`. With
  /// Δ/step = m + f, 0 <= f < 1, successive packets are m or m + 1 steps apart, the latter in a
  /// share f: M = (1 − f)P^m + f·P^(m+1), which is exact for P₂ and, for f > 0, an upper bound for
  /// the spread of positively correlated losses.
  static ChannelExpectation stepped(const Matrix& probabilities, double step_s, double interval_s,
                                    std::vector<ExpectedState> states);

  /// Packets that the states let through are lost with this probability, independently.
  void lose_independently(double probability);

  /// The delays within a state are correlated, so that their quantiles' variance inflation factors
  /// are up to `vif` larger than the states alone would make them.
  void add_delay_vif(double vif) { more_delay_vif_ += vif; }

  double prr() const { return 1.0 - loss_; }
  /// Packets; NaN if nothing is ever lost, infinite if everything is.
  double mean_burst() const;
  /// NaN if nothing or everything is lost.
  double lag1_correlation() const;
  /// For intervals of LossRecord. Asymptotic: for positively correlated losses an upper bound
  /// of what a finite run shows.
  const LossSpread& spread() const { return spread_; }

  const std::vector<ExpectedState>& states() const { return states_; }
  const std::vector<double>& stationary() const { return stationary_; }
  /// From the state that a packet meets to that of the next one (stepped() with f > 0: the mean of
  /// both).
  const Matrix& transition() const { return transition_; }
  /// Mean sojourn time; infinite if the state is never left.
  double mean_sojourn(std::size_t state) const { return sojourns_[state]; }
  Unit sojourn_unit() const { return unit_; }
  /// Mean number of changes of state per second; 0 for models that move by packets.
  double changes_per_s() const;

  /// P[delay <= delay_s] of all received packets; 0 if there are none.
  double delay_cdf(double delay_s) const;
  /// The smallest delay that a share `q`, 0 < q < 1, of the received packets does not exceed, to
  /// 1e-12 of its value; s. NaN if nothing is received or the quantile is beyond 10⁶ s.
  double delay_quantile(double q) const;
  /// Every received packet has the same delay, to 2 ns.
  bool delay_is_constant() const;
  /// Variance inflation of the share of received packets whose delay is at most delay_quantile(q),
  /// at least 1, for DelayStatistics::quantile().
  double delay_vif(double q) const;

 private:
  /// `moves`: rates or probabilities with the same stationary distribution.
  ChannelExpectation(Matrix transition, std::vector<ExpectedState> states, const Matrix& moves);
  void predict_losses();
  LossSpread make_spread() const;

  Matrix transition_;
  std::vector<ExpectedState> states_;
  std::vector<double> stationary_;
  std::vector<double> sojourns_;
  Unit unit_ = Unit::packets;
  double loss_ = 0.0;
  double loss_pair_ = 0.0;  // P₂
  double more_delay_vif_ = 0.0;
  LossSpread spread_;
};

}  // namespace tether
