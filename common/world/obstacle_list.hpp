#pragma once

#include <string>

#include "common/scenario/section.hpp"

namespace tether {

/// [[world.obstacle]]: the obstacles of Surroundings.
TableList obstacle_list();
std::string obstacle_help();

}  // namespace tether
