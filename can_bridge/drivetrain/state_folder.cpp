#include "can_bridge/drivetrain/state_folder.hpp"

#include <fmt/format.h>

#include <cstdlib>

namespace tether {

namespace fs = std::filesystem;

fs::path state_folder() {
  const auto of = [](const char* name) {
    const char* value = std::getenv(name);
    return std::string(value == nullptr ? "" : value);
  };
  if (const std::string state = of("STATE_DIRECTORY"); !state.empty()) {
    return state.substr(0, state.find(':'));
  }
  if (const std::string xdg = of("XDG_STATE_HOME"); !xdg.empty()) return fs::path(xdg) / "tether";
  if (const std::string home = of("HOME"); !home.empty()) {
    return fs::path(home) / ".local/state/tether";
  }
  return "/var/lib/tether";
}

fs::path default_commission_record(const std::string& vehicle, const std::string& interface) {
  return state_folder() / fmt::format("commissioned.{}.{}.toml", vehicle, interface);
}

}  // namespace tether
