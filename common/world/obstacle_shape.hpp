#pragma once

#include "common/world/surroundings.hpp"

namespace tether {

/// The outline that an obstacle has at t = 0; of a rack, its shelf.
Shape shape_of(const Obstacle& obstacle);

}  // namespace tether
