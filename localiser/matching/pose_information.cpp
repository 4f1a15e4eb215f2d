#include "localiser/matching/pose_information.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "localiser/matching/symmetric.hpp"

namespace tether {
namespace {

/// Information on the yaw from another source (odometry): 0.2 rad. Else a position beside a
/// circle's centre would be unknown wherever the yaw is.
constexpr double kOtherwise = 25.0;

double sigma_of(double information) {
  constexpr double kLeast = 1.0 / (Weakness::kNothing * Weakness::kNothing);
  return 1.0 / std::sqrt(std::max(information, kLeast));
}

/// Information `of` that remains if the same measurement also estimates the rest.
double left_of(double of, double coupling, double rest) {
  return rest > 0.0 ? of - coupling * coupling / rest : of;
}

}  // namespace

Weakness weakness(const PoseInformation& information) {
  const Eigen::Matrix3d all = matrix_of(information);
  Eigen::Matrix2d position = all.topLeftCorner<2, 2>();
  const Eigen::Vector2d coupling = all.topRightCorner<2, 1>();
  const double yaw = all(2, 2);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> known(position);
  double yaw_left = yaw;
  for (int i = 0; i < 2; ++i) {
    yaw_left = left_of(yaw_left, known.eigenvectors().col(i).dot(coupling), known.eigenvalues()(i));
  }
  position -= coupling * coupling.transpose() / (yaw + kOtherwise);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> left(position);
  const Eigen::Vector2d weak = left.eigenvectors().col(0);
  double direction_rad = std::atan2(weak.y(), weak.x());
  if (direction_rad <= -0.5 * std::numbers::pi) direction_rad += std::numbers::pi;
  if (direction_rad > 0.5 * std::numbers::pi) direction_rad -= std::numbers::pi;
  return {direction_rad, sigma_of(left.eigenvalues()(0)), sigma_of(yaw_left)};
}

PoseCovariance covariance_of(const PoseInformation& information) {
  return covariance_from(matrix_of(information).inverse());
}

}  // namespace tether
