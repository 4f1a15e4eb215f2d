#pragma once

#include <functional>

namespace tether {

/// What the chosen subcommand does, returning the exit code; main() calls it after parsing.
using Action = std::function<int()>;

}  // namespace tether
