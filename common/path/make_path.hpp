#pragma once

#include <memory>

#include "common/path/reference_path.hpp"
#include "common/scenario/scenario.hpp"

namespace tether {

/// The path that a scenario's [path] describes.
std::shared_ptr<const ReferencePath> make_path(const Scenario::Path& config);

}  // namespace tether
