#pragma once

#include "common/event_loop.hpp"
#include "common/timer_queue.hpp"

namespace tether {

/// Simulated time: jumps from event to event, as fast as the CPU goes. Deterministic: events
/// run in order of (time, priority, insertion), in the calling thread.
class VirtualLoop final : public EventLoop {
 public:
  explicit VirtualLoop(Instant start = kStart) : now_(start) {}

  Instant now() const override { return now_; }
  double rate() const override { return 0.0; }
  void at(Instant when, Priority priority, Task task) override;
  void every(Instant first, Duration period, Priority priority, Task task) override;
  [[noreturn]] void add_fd(int fd, Task task) override;
  void remove_fd(int) override {}
  void stop() override { stopped_ = true; }
  std::uint64_t slips() const override { return 0; }

  /// Runs all events up to and including `end`, then sets the time to `end`. Returns early,
  /// with the time of the last event, if a task called stop() or threw.
  void run_until(Instant end);

 private:
  TimerQueue timers_;
  Instant now_;
  bool stopped_ = false;
};

}  // namespace tether
