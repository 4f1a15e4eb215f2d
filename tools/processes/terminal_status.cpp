#include "tools/processes/terminal_status.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cstdio>

namespace tether {
namespace {

/// Columns and rows; 0 where the terminal does not say.
winsize size_of_terminal() {
  winsize size{};
  ioctl(STDERR_FILENO, TIOCGWINSZ, &size);
  return size;
}

/// Longest beginning that fits into a row, up to a blank: half a number is a wrong one.
std::string cut_to_terminal(const std::string& line) {
  const std::size_t columns = size_of_terminal().ws_col;
  const bool has_escapes = line.find('\033') != std::string::npos;  // from who asked has_room()
  if (columns == 0 || has_escapes) return line;
  std::size_t shown = 0;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const bool begins = (static_cast<unsigned char>(line[i]) & 0xc0U) != 0x80U;  // in UTF-8
    if (begins && ++shown > columns) return line.substr(0, line.find_last_of(' ', i));
  }
  return line;
}

}  // namespace

TerminalStatus::TerminalStatus(bool wanted) : shown_(wanted && isatty(STDERR_FILENO) != 0) {}

bool TerminalStatus::has_room(int columns, int rows) const {
  const winsize size = size_of_terminal();
  return shown_ && size.ws_col >= columns && size.ws_row > rows;
}

std::string TerminalStatus::erasure() const {
  if (!shown_) return "";
  const std::string up = lines_.size() > 1 ? fmt::format("\033[{}A", lines_.size() - 1) : "";
  return "\r" + up + (lines_.size() > 1 ? "\033[J" : "\033[K");  // to the end: of all, of the line
}

std::string TerminalStatus::rewritten(std::size_t before, const std::vector<std::string>& lines) {
  const std::string up = before > 1 ? fmt::format("\033[{}A", before - 1) : "";
  return fmt::format("\r{}{}\033[J", up, fmt::join(lines, "\033[K\n"));
}

void TerminalStatus::show(const std::vector<std::string>& lines) {
  if (!shown_) return;
  const std::size_t before = lines_.size();
  lines_ = lines;
  for (std::string& line : lines_) line = cut_to_terminal(line);
  fmt::print(stderr, "{}", rewritten(before, lines_));
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
