#pragma once

#include <filesystem>
#include <string>

namespace tether {

/// Keeps another process from writing the same sweep's database at the same time, by a file beside
/// it with ".lock" behind its name. Throws UsageError where another one does.
class SweepLock {
 public:
  explicit SweepLock(const std::filesystem::path& database);
  ~SweepLock();
  SweepLock(const SweepLock&) = delete;
  SweepLock& operator=(const SweepLock&) = delete;

 private:
  /// Not removed by its last owner between our opening and locking it.
  bool is_still_there() const;

  std::string file_;
  int fd_ = -1;
};

}  // namespace tether
