#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/base/time.hpp"
#include "common/node/event_loop.hpp"

namespace tether {

/// Place of an event in a run that several nodes share (docs/reference/time.md). Events happen by
/// time, then by TimerQueue's order; a message that several nodes receive is one event for each, by
/// the nodes' rank. The default is after everything.
struct EventKey {
  Instant when = Instant::max();
  std::uint64_t order = INT64_MAX;
  std::int32_t rank = INT32_MAX;

  // NOLINTNEXTLINE(modernize-use-nullptr): a false alarm
  friend auto operator<=>(const EventKey&, const EventKey&) = default;
};

/// Times as the protocol's messages have them.
inline Instant from_ns(std::int64_t ns) { return Instant{Duration{ns}}; }
inline std::int64_t to_ns(Instant t) { return t.time_since_epoch().count(); }

/// The first number of what is scheduled or published under a grant. Grants follow one another and
/// their numbers grow, so these numbers sort as those of one queue for all nodes would. A grant has
/// room for 2^24 numbers, a run for 2^32 grants.
constexpr std::uint64_t first_insertion(std::int64_t grant) {
  return static_cast<std::uint64_t>(grant) << 24;
}

/// Number of the first grant. What a node schedules before it joins has the node's rank, a smaller
/// number, in place of a grant's.
inline constexpr std::int64_t kFirstGrant = 16;

/// Pending tasks ordered by (time, priority, insertion): the part that all event loops share.
/// Priority and insertion are one number, the task's order: the priority in the top byte.
class TimerQueue {
 public:
  using Task = EventLoop::Task;

  static constexpr std::uint64_t order_of(Priority priority, std::uint64_t insertion) {
    return static_cast<std::uint64_t>(priority) << 56 | insertion;
  }

  void add(Instant when, Priority priority, Task task);
  /// A task that adds itself again, `period` later, each time it is run.
  void add_periodic(Instant first, Duration period, Priority priority, Task task);

  /// The first of first, first + period, first + 2·period… that is not before `now`.
  static Instant not_before(Instant now, Instant first, Duration period);

  bool empty() const { return heap_.empty() && due_.empty(); }
  /// Time of the earliest task; Instant::max() if there is none.
  Instant next() const { return empty() ? Instant::max() : front().when; }
  /// Period of the earliest task, zero if it runs once. Not on an empty queue.
  Duration next_period() const { return slots_[front().slot].period; }
  /// Takes the earliest task off and runs it. A task that throws is not run again, periodic or not.
  /// Not on an empty queue.
  void run_next();

  /// From here on: for loops that share one numbering of insertions. The order of the earliest
  /// task; UINT64_MAX on an empty queue.
  std::uint64_t next_order() const { return empty() ? UINT64_MAX : front().order; }
  /// The number of the next insertion, < 2^56.
  std::uint64_t insertions() const { return insertions_; }
  void set_insertions(std::uint64_t insertions) { insertions_ = insertions; }
  /// Takes a number, as an insertion would, for an event that happens elsewhere.
  std::uint64_t take_insertion() { return insertions_++; }
  /// Inserts a task whose order is given.
  void add_in_order(Instant when, std::uint64_t order, Task task);

 private:
  struct Entry {
    Instant when;
    std::uint64_t order;
    std::uint32_t slot;

    bool is_before(const Entry& other) const {
      return when != other.when ? when < other.when : order < other.order;
    }
  };
  struct alignas(64) Slot {  // a line of a cache
    Task task;
    Duration period{0};
    Priority priority{};
  };

  bool is_due_first() const {
    return !due_.empty() && (heap_.empty() || due_[due_taken_].is_before(heap_.front()));
  }
  const Entry& front() const { return is_due_first() ? due_[due_taken_] : heap_.front(); }
  Entry take_front();
  void push(Instant when, Priority priority, std::uint32_t slot);
  void push_in_order(Instant when, std::uint64_t order, std::uint32_t slot);
  std::uint32_t allocate(Slot slot);

  std::vector<Entry> heap_;
  /// Events of the present instant that were added in order: most messages, which so are spared
  /// the way through the heap. The first due_taken_ are taken; empty once all are.
  std::vector<Entry> due_;
  std::size_t due_taken_ = 0;
  Instant running_ = Instant::min();
  std::vector<Slot> slots_;
  std::vector<std::uint32_t> free_slots_;
  std::uint64_t insertions_ = 0;
};

}  // namespace tether
