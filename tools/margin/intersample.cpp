#include "tools/margin/intersample.hpp"

#include <unsupported/Eigen/MatrixFunctions>

namespace tether {

using Eigen::MatrixXd;

EventInterval between_events(const MatrixXd& a, const MatrixXd& r, const MatrixXd& q, double h_s) {
  const Eigen::Index n = a.rows();
  MatrixXd blocks = MatrixXd::Zero(2 * n, 2 * n);
  blocks.topLeftCorner(n, n) = -a;
  blocks.topRightCorner(n, n) = r;
  blocks.bottomRightCorner(n, n) = a.transpose();
  const MatrixXd of_noise = (blocks * h_s).exp();
  blocks = MatrixXd::Zero(3 * n, 3 * n);
  blocks.topLeftCorner(n, n) = -a.transpose();
  blocks.block(0, n, n, n).setIdentity();
  blocks.block(n, n, n, n) = -a.transpose();
  blocks.block(n, 2 * n, n, n) = q;
  blocks.bottomRightCorner(n, n) = a;
  const MatrixXd of_cost = (blocks * h_s).exp();

  EventInterval interval;
  interval.phi = of_cost.bottomRightCorner(n, n);
  interval.noise = interval.phi * of_noise.topRightCorner(n, n);
  interval.cost = interval.phi.transpose() * of_cost.block(n, 2 * n, n, n);
  // ∫ tr(Q noise(t)) dt = tr(R ∫ cost(t) dt).
  interval.noise_cost = (r * interval.phi.transpose() * of_cost.topRightCorner(n, n)).trace();
  return interval;
}

}  // namespace tether
