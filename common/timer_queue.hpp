#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/event_loop.hpp"

namespace tether {

/// Pending tasks ordered by (time, priority, insertion): the part that all event loops share.
class TimerQueue {
 public:
  using Task = EventLoop::Task;

  void add(Instant when, Priority priority, Task task);
  /// A task that adds itself again, `period` later, each time it is run.
  void add_periodic(Instant first, Duration period, Priority priority, Task task);

  /// The first of first, first + period, first + 2·period… that is not before `now`.
  static Instant not_before(Instant now, Instant first, Duration period);

  bool empty() const { return heap_.empty(); }
  /// Time of the earliest task; Instant::max() if there is none.
  Instant next() const { return heap_.empty() ? Instant::max() : heap_.front().when; }
  /// Period of the earliest task, zero if it runs once. Not on an empty queue.
  Duration next_period() const { return slots_[heap_.front().slot].period; }
  /// Takes the earliest task off and runs it. A task that throws is not run again, periodic or not.
  /// Not on an empty queue.
  void run_next();

 private:
  struct Entry {
    Instant when;
    std::uint64_t order;  // priority in the top byte, insertion count below
    std::uint32_t slot;
  };
  struct Slot {
    Task task;
    Duration period{0};
    Priority priority{};
  };
  struct Later;

  void push(Instant when, Priority priority, std::uint32_t slot);
  std::uint32_t allocate(Slot slot);

  std::vector<Entry> heap_;
  std::vector<Slot> slots_;
  std::vector<std::uint32_t> free_slots_;
  std::uint64_t insertions_ = 0;
};

}  // namespace tether
