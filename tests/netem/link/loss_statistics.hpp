#pragma once

#include "netem/models/four_state.hpp"
#include "netem/models/gilbert_elliott.hpp"
#include "netem/models/markov_chain.hpp"

namespace tether {

/// Long-run statistics of a loss model that takes one step per packet, computed from its
/// parameters: the yardstick for what a run achieved.
///
/// For a chain with step matrix M, stationary distribution π and loss probability e_i of a packet
/// that meets state i: P = Σ π_i e_i; two successive losses P_LL = Σ π_i e_i M_ij e_j; mean length
/// of loss bursts P/(P − P_LL); autocovariance of the loss indicator at lag k ≥ 1
/// c_k = Σ π_i e_i (M^k e)_i − P². The loss ratio over n packets has variance
/// ≈ P(1−P)/n · VIF, VIF = 1 + 2 Σ_k c_k / (P(1−P)).
class LossStatistics {
 public:
  /// Every state must lead to one closed class of states (stationary_distribution()); else nullopt.
  static std::optional<LossStatistics> of_chain(const Matrix& steps, std::vector<double> loss);
  static std::optional<LossStatistics> of(const GilbertElliott& model);
  static std::optional<LossStatistics> of(const FourState& model);

  double loss_ratio() const { return loss_ratio_; }
  /// Infinite if a loss is always followed by another; 0 if nothing is ever lost.
  double mean_burst() const;
  /// At lag >= 1; at lag 0 it is P(1−P).
  double autocovariance(int lag) const;
  /// 1 if the loss ratio is 0 or 1.
  double variance_inflation() const { return variance_inflation_; }
  /// Standard deviation of the loss ratio over `packets` packets.
  double loss_ratio_sd(double packets) const;

 private:
  LossStatistics(Matrix steps, std::vector<double> loss, std::vector<double> share);

  Matrix steps_;
  std::vector<double> loss_;
  std::vector<double> share_;
  double loss_ratio_ = 0.0;
  double variance_inflation_ = 1.0;
};

/// The two models as chains, for those who need the states.
Matrix step_matrix(const GilbertElliott& model);
Matrix step_matrix(const FourState& model);

}  // namespace tether
