#pragma once

#include <deque>
#include <string>

#include "common/loop/event_loop.hpp"
#include "tools/lockstep/time_manager.hpp"

namespace tether {

/// Holds a run in lockstep and steps it, by lines from a terminal or a pipe:
///   (empty) or s [N]   one grant, or N of them
///   u SECONDS          run until this time
///   c                  go on to the end
///   p                  stop at once
///   q                  end the run
/// Lines wait until the run stands still. Only p and q act at once, and the lines that wait are
/// then forgotten. Says where the run stands each time it comes to stand still. When the input
/// ends, the run goes on.
class StepConsole {
 public:
  /// Holds the run from its beginning. All must outlive the console.
  StepConsole(EventLoop& io, TimeManager& manager, int fd);
  ~StepConsole();
  StepConsole(const StepConsole&) = delete;
  StepConsole& operator=(const StepConsole&) = delete;

 private:
  void read_input();
  bool read_some();
  void take_lines();
  void obey(const std::string& line);
  void show();

  EventLoop& io_;
  TimeManager& manager_;
  int fd_;
  std::string input_;              // an unfinished line
  std::deque<std::string> lines_;  // waiting lines
  bool at_end_ = false;            // end of the input
  int steps_left_ = 0;
};

}  // namespace tether
