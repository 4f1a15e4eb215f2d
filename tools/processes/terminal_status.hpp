#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace tether {

/// Status lines at the end of a terminal (standard error) that change in place while a program
/// runs; lines that are said meanwhile stay above it. Without a terminal only these are written.
class TerminalStatus {
 public:
  /// `wanted`: false for lines only, whatever standard error is.
  explicit TerminalStatus(bool wanted);

  bool shown() const { return shown_; }
  /// Whether the terminal, as large as it is now, has room for so much and the line below it.
  bool has_room(int columns, int rows) const;

  /// Replaces the status, over what stands there, which is not taken away first: it would flicker.
  /// What does not fit into a row is cut off: a line that wraps would stay.
  void show(const std::vector<std::string>& lines);
  /// Writes a line that stays.
  void say(const std::string& line);
  /// Takes the status away.
  void clear();

  /// Text that makes a terminal write `lines` over a status of `before` lines. Pure.
  static std::string rewritten(std::size_t before, const std::vector<std::string>& lines);

 private:
  std::string erasure() const;

  bool shown_;
  std::vector<std::string> lines_;
};

}  // namespace tether
