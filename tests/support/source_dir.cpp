#include "tests/support/source_dir.hpp"

namespace tether {

std::string in_source(const std::string& name) { return TETHER_SOURCE_DIR + name; }

}  // namespace tether
