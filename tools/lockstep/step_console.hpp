#pragma once

#include <string>

#include "common/event_loop.hpp"
#include "tools/lockstep/time_manager.hpp"

namespace tether {

/// Holds a run in lockstep and steps it, by lines from a terminal or a pipe:
///   (empty) or s [N]   one grant, or N of them
///   u SECONDS          run until this time
///   c                  go on to the end, p: stop again
///   q                  end the run
/// Says where the run stands each time it comes to stand still. When the input ends, the run goes
/// on.
class StepConsole {
 public:
  /// Holds the run from its beginning. All must outlive the console.
  StepConsole(EventLoop& io, TimeManager& manager, int fd);
  ~StepConsole();
  StepConsole(const StepConsole&) = delete;
  StepConsole& operator=(const StepConsole&) = delete;

 private:
  void read_input();
  void take_lines();
  void obey(const std::string& line);
  void show();

  EventLoop& io_;
  TimeManager& manager_;
  int fd_;
  std::string input_;
  bool at_end_ = false;  // of the input
  int steps_left_ = 0;
};

}  // namespace tether
