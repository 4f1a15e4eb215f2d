#pragma once

#include <string>

namespace tether {

/// Returns the file or folder `name` ("/scenarios/paper.toml") of the source tree. Its location is
/// compiled in one place, so that the tests' objects are the same in every clone.
std::string in_source(const std::string& name);

}  // namespace tether
