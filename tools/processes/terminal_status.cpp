#include "tools/processes/terminal_status.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cstdio>

namespace tether {

TerminalStatus::TerminalStatus(bool wanted) : shown_(wanted && isatty(STDERR_FILENO) != 0) {}

bool TerminalStatus::has_room(int columns, int rows) const {
  winsize size{};
  return shown_ && ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col >= columns &&
         size.ws_row > rows;
}

std::string TerminalStatus::erasure() const {
  if (!shown_) return "";
  const std::string up = lines_.size() > 1 ? fmt::format("\033[{}A", lines_.size() - 1) : "";
  return "\r" + up + (lines_.size() > 1 ? "\033[J" : "\033[K");  // to the end: of all, of the line
}

void TerminalStatus::show(const std::vector<std::string>& lines) {
  if (!shown_) return;
  fmt::print(stderr, "{}{}", erasure(), fmt::join(lines, "\n"));
  lines_ = lines;
  std::fflush(stderr);
}

void TerminalStatus::say(const std::string& line) {
  fmt::print(stderr, "{}{}\n", erasure(), line);
  const std::vector<std::string> status = std::move(lines_);
  lines_.clear();
  if (!status.empty()) show(status);
}

void TerminalStatus::clear() {
  if (!shown_) return;
  fmt::print(stderr, "{}", erasure());
  lines_.clear();
  std::fflush(stderr);
}

}  // namespace tether
