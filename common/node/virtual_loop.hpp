#pragma once

#include "common/node/event_loop.hpp"
#include "common/node/timer_queue.hpp"

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

/// Simulated time: jumps from event to event, as fast as the CPU goes. Deterministic: events
/// run in order of (time, priority, insertion), in the calling thread.
class VirtualLoop final : public SimulatedLoop {
 public:
  explicit VirtualLoop(Instant start = kStart) : SimulatedLoop(start) {}

  void stop() override { stopped_ = true; }

  /// Runs all events up to and including `end`, then sets the time to `end`. Returns early,
  /// with the time of the last event, if a task called stop() or threw.
  void run_until(Instant end);

 private:
  bool stopped_ = false;
};

}  // namespace tether
