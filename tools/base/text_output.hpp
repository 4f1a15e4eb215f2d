#pragma once

#include <cerrno>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

namespace tether {

/// Text to a file or to standard output, where a failed write (disk full, no permission) is an
/// exception that names the file. Call close() at the end: much of it shows only then.
class TextOutput {
 public:
  /// Empty `path`: standard output. Overwrites a file that exists.
  explicit TextOutput(std::string path = "")
      : owned_(!path.empty()),
        name_(owned_ ? std::move(path) : "standard output"),
        file_(owned_ ? std::fopen(name_.c_str(), "w") : stdout) {
    if (file_ == nullptr) fail();
  }
  ~TextOutput() {
    if (owned_ && file_ != nullptr) std::fclose(file_);
  }
  TextOutput(const TextOutput&) = delete;
  TextOutput& operator=(const TextOutput&) = delete;

  void write(std::string_view text) {
    if (std::fwrite(text.data(), 1, text.size(), file_) != text.size()) fail();
  }

  void flush() {
    if (std::fflush(file_) != 0) fail();
  }

  void close() {
    flush();
    if (!owned_) return;
    std::FILE* const file = std::exchange(file_, nullptr);
    if (std::fclose(file) != 0) fail();
  }

 private:
  [[noreturn]] void fail() const {
    throw std::runtime_error("cannot write " + name_ + ": " +
                             std::generic_category().message(errno));
  }

  bool owned_;
  std::string name_;
  std::FILE* file_;
};

}  // namespace tether
