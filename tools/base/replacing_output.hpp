#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace tether {

/// Suffix that write_file() adds to the name of a file that is not complete yet.
inline constexpr std::string_view kUnfinished = ".unfinished";

/// Replaces what was in the file once all is written: it stays as it was otherwise. Throws
/// std::runtime_error with the system's reason unless all has reached it.
void write_file(const std::filesystem::path& file, const std::string& text);

/// Same as write_file(), for content too long for memory: bytes go to a file beside it, which
/// takes its place when all is written. Until close(), what was there stays.
class ReplacingOutput {
 public:
  /// Throws std::runtime_error with the system's reason, as all functions do.
  explicit ReplacingOutput(std::filesystem::path file);
  /// Removes what is not complete.
  ~ReplacingOutput();
  ReplacingOutput(const ReplacingOutput&) = delete;
  ReplacingOutput& operator=(const ReplacingOutput&) = delete;

  void write(std::string_view bytes);
  void close();

 private:
  [[noreturn]] void fail(int error) const;

  std::filesystem::path file_;
  bool replace_ = true;  // not a device
  std::filesystem::path written_;
  int fd_ = -1;
};

}  // namespace tether
