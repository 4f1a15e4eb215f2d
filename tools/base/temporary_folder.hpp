#pragma once

#include <filesystem>

namespace tether {

/// A folder of this program alone, gone with it.
class TemporaryFolder {
 public:
  /// Throws std::runtime_error with the system's reason.
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace tether
