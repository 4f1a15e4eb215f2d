#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "tools/margin/loss_chain.hpp"

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

struct LyapunovTrial {
  std::size_t periods = 100'000;
  std::uint64_t seed = 1;
};

/// Growth of |z| per period along almost every sequence of losses: exp of the top Lyapunov exponent
/// lim ln|z_k|/k (Furstenberg, Kesten, 1960; Oseledets, 1968), along one drawn sequence. Below 1,
/// errors vanish with probability 1. This is weaker than mean-square stability (Jensen): in
/// between, errors vanish, but seldom get so large that their mean square grows. Sequences of one
/// seed take the same draws, so that the growth is comparable between chains of as many states. 0
/// where z vanishes.
double almost_sure_growth(const LossChain& chain, const std::vector<LoopStep>& steps,
                          const LyapunovTrial& trial = {});

/// Where along a range a loop stops being stable.
struct Critical {
  enum class Kind {
    found,
    always,        ///< stable in the whole range
    never,         ///< nowhere stable
    not_monotone,  ///< it changes sides more than once: there is no single critical value
  };
  Kind kind = Kind::never;
  double value = 0.0;  ///< found: to `tolerance`

  bool operator==(const Critical&) const = default;
};

/// Bisection of radius(x) = 1 between `low` and `high`. Assumes that the radius passes 1 once, from
/// either side, and checks that on 25 points. A radius just at 1 counts as stable to 1e-7: so does
/// a loop that has nothing to correct.
Critical critical_value(const std::function<double(double)>& radius, double low, double high,
                        double tolerance);

}  // namespace tether
