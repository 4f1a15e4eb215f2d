#pragma once

#include <optional>
#include <vector>

namespace tether {

/// Minimise x·Hx/2 + g·x with lower ≤ x ≤ upper; H is symmetric and positive definite.
struct BoxQp {
  std::vector<double> hessian;  ///< H, n × n, row by row
  std::vector<double> gradient;
  std::vector<double> lower, upper;
};

/// The minimum, from a start within the bounds, or nullopt if the solver failed. Deterministic;
/// calls share nothing.
///
/// By NLopt's L-BFGS with bounds (L. Lukšan's subroutines). docs/explanation/benchmark.md compares
/// it with other solvers.
std::optional<std::vector<double>> solve(const BoxQp& qp, std::vector<double> start);

}  // namespace tether
