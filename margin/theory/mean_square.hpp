#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <vector>

#include "margin/theory/loss_chain.hpp"

namespace tether {

/// A period of a sampled loop, by what became of the command: z⁺ = A_mode z + noise.
struct LoopStep {
  std::array<Eigen::MatrixXd, 2> a;      ///< by LossChain::Mode, n × n
  std::array<Eigen::MatrixXd, 2> noise;  ///< covariance of what the poses' noise adds, n × n
  std::vector<bool> is_along;            ///< per component, on a straight
};

/// Growth of the second moments per period of the Markov jump linear system z⁺ = A_mode z, whose
/// steps repeat: the spectral radius of
///   (X_i) ↦ Σ_i p_ij A_i X_i A_iᵀ,
/// which is that of (Pᵀ ⊗ I)·diag(A_i ⊗ A_i), of K steps the K-th root of that of their product.
/// Mean-square stable if and only if it is below 1 (Costa, Fragoso, Marques: Discrete-Time Markov
/// Jump Linear Systems, Springer 2005, Theorem 3.9; for periodic systems of the product over a
/// period).
///
/// By power iteration on the operator plus the identity, from the identity: the operator leaves the
/// cone of positive semidefinite X_i invariant, so that its spectral radius is an eigenvalue of it
/// (Krein, Rutman, 1948), and the only one of the sum's that has its modulus. To about 1e-8.
double mean_square_radius(const LossChain& chain, const std::vector<LoopStep>& steps);

/// The same of two general modes, for which state i of a chain is mode i: `p` is its matrix.
double mean_square_radius(const Matrix& p, const std::vector<Eigen::MatrixXd>& modes);

/// The stationary second moments E[z zᵀ] at the beginning of each step, where the last component of
/// z is always 1, and the noise is the steps'. Fixed point of X_j = Σ_i p_ij (A_i X_i A_iᵀ + π_i
/// N_i), by iteration. nullopt where that does not settle within 10⁵ periods: at the edge of
/// stability, or beyond.
std::optional<std::vector<Eigen::MatrixXd>> stationary_moments(const LossChain& chain,
                                                               const std::vector<LoopStep>& steps);

}  // namespace tether
