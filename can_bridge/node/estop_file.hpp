#pragma once

#include <filesystem>
#include <string>

namespace tether {

/// Remembers on disk that the e-stop is latched, so that it outlives a crash of the bridge, a
/// restart and a power failure: the file exists while it is. A bridge that finds it starts with the
/// e-stop pressed, and RELEASE and RESET remove it.
class EstopFile {
 public:
  /// Makes the folder, and sees whether it can be written to. Throws UsageError if not: a bridge
  /// that could not remember must not start.
  explicit EstopFile(std::filesystem::path path);

  bool latched() const { return latched_; }
  /// Each cycle; touches the disk only when it changes. Waits for the disk (fsync): a stop has been
  /// sent before. A failure is said on stderr once, and tried again in the next cycle.
  void remember(bool latched);

 private:
  bool write() const;

  std::filesystem::path path_;
  bool latched_;
  bool failed_ = false;
};

/// Where bridges with real drives keep it: estop.VEHICLE.INTERFACE in $STATE_DIRECTORY (systemd),
/// else $XDG_STATE_HOME/tether, else ~/.local/state/tether, else /var/lib/tether.
std::filesystem::path default_estop_file(const std::string& vehicle, const std::string& interface);

}  // namespace tether
