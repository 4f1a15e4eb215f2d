#include "controller/mpc/box_qp.hpp"

#include <Eigen/Core>
#include <nlopt.hpp>
#include <stdexcept>

namespace tether {
namespace {

using Eigen::Map;
using Eigen::VectorXd;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr double kTolerance = 1e-9;  // tolerance of the cost, relative
constexpr int kMostEvaluations = 500;

double cost(const std::vector<double>& x, std::vector<double>& slope, void* data) {
  const auto& qp = *static_cast<const BoxQp*>(data);
  const auto n = static_cast<Eigen::Index>(x.size());
  const Map<const VectorXd> at(x.data(), n), gradient(qp.gradient.data(), n);
  const VectorXd h = Map<const Matrix>(qp.hessian.data(), n, n) * at;
  if (!slope.empty()) Map<VectorXd>(slope.data(), n) = h + gradient;
  return 0.5 * at.dot(h) + gradient.dot(at);
}

}  // namespace

std::optional<std::vector<double>> solve(const BoxQp& qp, std::vector<double> start) {
  nlopt::opt search(nlopt::LD_LBFGS, static_cast<unsigned>(start.size()));
  BoxQp data = qp;
  search.set_min_objective(cost, &data);
  search.set_lower_bounds(qp.lower);
  search.set_upper_bounds(qp.upper);
  search.set_ftol_rel(kTolerance);
  search.set_maxeval(kMostEvaluations);
  double least = 0.0;
  try {
    search.optimize(start, least);
  } catch (const nlopt::roundoff_limited&) {  // the result is as good as rounding allows
  } catch (const std::runtime_error&) {
    return std::nullopt;
  }
  return start;
}

}  // namespace tether
