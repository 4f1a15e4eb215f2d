#pragma once

#include <limits>

namespace tether {

inline constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

}  // namespace tether
