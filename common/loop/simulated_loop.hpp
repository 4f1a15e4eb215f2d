#pragma once

#include "common/loop/event_loop.hpp"
#include "common/loop/timer_queue.hpp"

namespace tether {

/// Base of loops in simulated time: a queue of tasks, and a time that only the loop's owner
/// moves. No signals and file descriptors reach it.
class SimulatedLoop : public EventLoop {
 public:
  explicit SimulatedLoop(Instant start) : now_(start) {}

  Instant now() const final { return now_; }
  double rate() const final { return 0.0; }
  void at(Instant when, Priority priority, Task task) final;
  void every(Instant first, Duration period, Priority priority, Task task) final;
  [[noreturn]] void add_fd(int fd, Task task) final;
  void remove_fd(int) final {}
  std::uint64_t slips() const final { return 0; }

 protected:
  /// Goes to the next task and runs it.
  void run_next() {
    now_ = timers_.next();
    timers_.run_next();
  }

  TimerQueue timers_;
  Instant now_;
};

}  // namespace tether
