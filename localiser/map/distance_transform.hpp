#pragma once

#include <cstdint>
#include <vector>

namespace tether {

/// For each cell of a grid, row by row, the squared distance of its centre to that of the nearest
/// seed, in cells; infinite if there is no seed. Exact, in a time proportional to the cells:
/// Felzenszwalb & Huttenlocher, Distance Transforms of Sampled Functions. Theory of Computing 8
/// (2012), 415–428.
std::vector<float> squared_distances(const std::vector<std::uint8_t>& seeds, int width);

}  // namespace tether
