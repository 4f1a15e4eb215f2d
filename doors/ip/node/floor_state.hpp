#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/base/errors.hpp"

namespace tether::ip {

/// A running host of a floor: its first process, whose namespaces are the host's.
struct HostEntry {
  std::string name;
  std::string address;
  pid_t process = 0;
};

/// $XDG_RUNTIME_DIR/tether-floor, or /tmp/tether-floor-UID.
std::filesystem::path default_floor_folder();

/// Folder of a running tether-tun: `lock`, which it holds as long as it lives, however it ends;
/// `hosts`, the names for /etc/hosts; and `state`, written when all hosts are up.
class FloorState {
 public:
  /// Takes the lock, and removes what an earlier tether-tun has left. Throws UsageError if another
  /// one holds it, or if the folder belongs to another user.
  explicit FloorState(std::filesystem::path folder);
  FloorState(const FloorState&) = delete;
  FloorState& operator=(const FloorState&) = delete;
  /// Removes the files.
  ~FloorState();

  const std::filesystem::path& folder() const { return folder_; }
  void write(const std::vector<HostEntry>& hosts) const;

 private:
  std::filesystem::path folder_;
  int lock_ = -1;
};

/// The error of a second floor in the folder.
UsageError already_up(const std::filesystem::path& folder);

/// The process that holds the folder's lock; nullopt if none does.
std::optional<pid_t> floor_process(const std::filesystem::path& folder);

/// The hosts that are up; empty if none are.
std::vector<HostEntry> read_hosts(const std::filesystem::path& folder);

/// Removes the folder and its files.
void remove_floor_folder(const std::filesystem::path& folder);

}  // namespace tether::ip
