#pragma once

#include <Eigen/Core>

namespace tether {

/// The interval between two events of a process ẋ = A x + v, with white noise v of intensity R and
/// the cost J = ∫ E[xᵀ Q x] dt. From second moments P = E[x xᵀ] at its beginning an interval of
/// `h_s` leads to `phi` P `phi`ᵀ + `noise`, and costs tr(`cost` P) + `noise_cost`.
struct EventInterval {
  Eigen::MatrixXd phi;      ///< e^{Ah}
  Eigen::MatrixXd noise;    ///< ∫ e^{As} R e^{Aᵀs} ds
  Eigen::MatrixXd cost;     ///< ∫ e^{Aᵀs} Q e^{As} ds
  double noise_cost = 0.0;  ///< ∫∫ tr(Q e^{As} R e^{Aᵀs}) ds dt, 0 ≤ s ≤ t ≤ h
};

/// By exponentials of block matrices (Van Loan: Computing integrals involving the matrix
/// exponential. IEEE Trans. Autom. Control 23 (3), 1978). They have e^{−Ah}, too: ‖A‖ h must not be
/// beyond some 20. R and Q are symmetric, h_s > 0.
EventInterval between_events(const Eigen::MatrixXd& a, const Eigen::MatrixXd& r,
                             const Eigen::MatrixXd& q, double h_s);

}  // namespace tether
