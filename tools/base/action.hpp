#pragma once

#include <functional>

namespace tether {

/// Function of the chosen subcommand, which returns the exit code; main() calls it after parsing.
using Action = std::function<int()>;

}  // namespace tether
