#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace tether {

/// Records messages as LCM event logs in a folder, and deletes the oldest of them for newer ones.
/// It never takes the file system's last space: there other programs keep what must not be lost.
/// Files are NAME-00000001.lcmlog, NAME-00000002.lcmlog …, over all starts.
class RotatingLog {
 public:
  struct Settings {
    std::filesystem::path folder;
    std::string name = "floor";
    std::uint64_t file_bytes = 1'000'000'000;  ///< a new file from there on
    std::uint64_t files = 20;  ///< kept, the one that is written included; at least 2
    std::uint64_t keep_free_bytes = 1'000'000'000;  ///< minimum free space on the file system
    /// Free bytes of the file system, of which root's reserve is no part.
    std::function<std::uint64_t(const std::filesystem::path&)> free_bytes = free_bytes_of;
  };

  /// Throws UsageError if the folder does not exist or cannot be written.
  explicit RotatingLog(Settings settings);

  /// False if the message is lost because there is no room.
  bool write(std::string_view channel, std::span<const std::uint8_t> bytes, std::int64_t utime);
  /// Hands over to the kernel what was written, and deletes old files where there are too many or
  /// too little space is free. If that does not help, the newest file ends and messages are lost
  /// until there is room again. Call it once a second. Throws std::system_error if the disk fails.
  void flush();

  std::int64_t written() const { return written_; }
  std::int64_t lost() const { return lost_; }
  const std::filesystem::path& file() const { return file_; }

  static std::uint64_t free_bytes_of(const std::filesystem::path& folder);

 private:
  void open_next();
  void end_file();
  void put(const void* bytes, std::size_t size);
  [[noreturn]] void fail() const;
  bool make_room();

  Settings settings_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> out_{nullptr, std::fclose};
  std::filesystem::path file_;
  std::uint64_t number_ = 0;
  std::uint64_t bytes_ = 0;  ///< size of this file
  std::int64_t written_ = 0;
  std::int64_t lost_ = 0;
};

}  // namespace tether
