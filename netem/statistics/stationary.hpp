#pragma once

#include <optional>
#include <vector>

namespace tether {

using Matrix = std::vector<std::vector<double>>;

/// Long-run share of time (or steps) in each state, from rates or probabilities of going from row
/// to column; the diagonal is not looked at. nullopt if it depends on where the chain begins: there
/// is more than one set of states that is never left. Subtraction-free elimination, so that small
/// probabilities keep their relative accuracy (Grassmann, Taksar, Heyman, Operations Research
/// 33(5), 1985).
std::optional<std::vector<double>> stationary_distribution(const Matrix& moves);

}  // namespace tether
