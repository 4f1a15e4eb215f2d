#pragma once

#include <string>

#include "common/scenario/key_table.hpp"

namespace tether {

/// The keys of [path].
void add_path_keys(KeyTable& t);

/// `path.kind is "circle"` for keys that the chosen kind of path ignores; empty for all others.
std::string why_path_ignores(const Scenario& scenario, const std::string& key);

}  // namespace tether
