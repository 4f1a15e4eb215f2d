#include "tools/lockstep/step_console.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <sstream>
#include <system_error>

namespace tether {

StepConsole::StepConsole(EventLoop& io, TimeManager& manager, int fd)
    : io_(io), manager_(manager), fd_(fd) {
  fmt::print(stderr,
             "Enter or s [N]: one grant, or N   u SECONDS: run until   c: go on   p: pause   q: "
             "quit\n");
  manager_.hold(Instant::min());
  // This is called in the middle of the manager's work, so the position is shown after it.
  manager_.on_held([this] {
    io_.at(io_.now(), Priority::node, [this](Instant) {
      if (manager_.held()) show();
    });
  });
  try {
    io_.add_fd(fd_, [this](Instant) { read_input(); });
  } catch (const std::system_error&) {  // a file, which is never waited for
    while (read_some()) {
    }
    fd_ = -1;
  }
}

StepConsole::~StepConsole() {
  if (fd_ >= 0) io_.remove_fd(fd_);
}

void StepConsole::read_input() {
  if (!read_some()) {
    io_.remove_fd(fd_);
    fd_ = -1;
  }
  take_lines();
}

/// False at the end of the input.
bool StepConsole::read_some() {
  std::array<char, 1024> buffer{};
  const ssize_t size = read(fd_, buffer.data(), buffer.size());
  at_end_ = size <= 0;
  if (!at_end_) input_.append(buffer.data(), static_cast<std::size_t>(size));
  for (auto end = input_.find('\n'); end != std::string::npos; end = input_.find('\n')) {
    const std::string line = input_.substr(0, end);
    input_.erase(0, end + 1);
    const bool at_once = line == "p" || line == "q";
    if (at_once) {
      lines_.clear();
      obey(line);
    } else {
      lines_.push_back(line);
    }
  }
  return !at_end_;
}

void StepConsole::take_lines() {
  while (!lines_.empty() && manager_.held()) {
    const std::string line = lines_.front();
    lines_.pop_front();
    obey(line);
  }
  if (at_end_ && lines_.empty() && manager_.held()) manager_.hold(Instant::max());
}

void StepConsole::show() {
  if (steps_left_ > 0) --steps_left_;
  const std::string& story = manager_.story();
  fmt::print(stderr, "t = {:.6f} s{}{}\n", to_seconds(manager_.next()),
             story.empty() ? "" : " is next, after ", story);
  if (steps_left_ > 0) {
    manager_.step();
  } else {
    take_lines();
  }
}

void StepConsole::obey(const std::string& line) {
  std::istringstream words(line);
  std::string word;
  words >> word;
  double value = 0.0;
  const bool has_value = static_cast<bool>(words >> value);
  if (word.empty() || word == "s") {
    steps_left_ = has_value ? static_cast<int>(std::clamp(value, 1.0, 1e9)) : 1;
    manager_.hold(Instant::min());
    manager_.step();
  } else if (word == "u" && has_value && std::abs(value) < 1e9) {
    manager_.hold(kStart + from_seconds(value));
  } else if (word == "c") {
    manager_.hold(Instant::max());
  } else if (word == "p") {
    steps_left_ = 0;
    manager_.hold(Instant::min());
  } else if (word == "q") {
    manager_.fail("ended from the terminal");
  } else {
    fmt::print(stderr, "not understood: {}\n", line);
  }
}

}  // namespace tether
