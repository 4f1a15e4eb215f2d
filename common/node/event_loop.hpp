#pragma once

#include <cstdint>
#include <functional>

#include "common/base/time.hpp"

namespace tether {

/// Order of events that fall on the same instant. The vehicle moves first, so that everything
/// else sees the world as it is at that instant; observers look last.
enum class Priority : std::uint8_t { physics, delivery, node, observer };

/// The only owner of a clock. Nodes are written against this interface and run unchanged in
/// virtual time (VirtualLoop) and in real time (RealTimeLoop).
///
/// Tasks receive the instant they were scheduled for. In virtual time that is `now()`; in real
/// time `now()` may be later, and a periodic task that fell behind is called once for every
/// missed period, with the instant it missed, so that integrators stay drift-free.
class EventLoop {
 public:
  using Task = std::function<void(Instant scheduled)>;

  virtual ~EventLoop() = default;

  virtual Instant now() const = 0;

  /// Which run this is, so that messages of another run are not taken for this one's (a log that is
  /// played again): its start, µs since 1970; 0 in virtual time, where nothing comes from outside.
  virtual std::int64_t run_id() const { return 0; }

  /// Intended run seconds per wall second; 0 = as fast as possible.
  virtual double rate() const = 0;

  /// Runs `task` once at `when`, or as soon as possible if that has passed.
  virtual void at(Instant when, Priority priority, Task task) = 0;

  /// Runs `task` at first, first + period, first + 2·period… `period` > 0. Starts with the first of
  /// them that is not past yet, so that a node that joins late keeps step with the others and does
  /// not catch up on what happened before it lived.
  virtual void every(Instant first, Duration period, Priority priority, Task task) = 0;

  /// Calls `task` whenever `fd` is readable. Virtual time has no file descriptors and throws.
  virtual void add_fd(int fd, Task task) = 0;

  /// Stops watching `fd`; before it is closed.
  virtual void remove_fd(int fd) = 0;

  /// Runs `work`, which takes long and must not throw, and then `then`: in simulated time both at
  /// once; in real time the work in a thread of its own, for which the loop waits when it ends.
  virtual void aside(std::function<void()> work, Task then) {
    work();
    then(now());
  }

  /// Makes run_until() return after the current task.
  virtual void stop() = 0;

  /// Deadline slips: periodic tasks that started later than one whole period. 0 in virtual time.
  virtual std::uint64_t slips() const = 0;

 protected:
  EventLoop() = default;
  EventLoop(const EventLoop&) = delete;
  EventLoop& operator=(const EventLoop&) = delete;
};

}  // namespace tether
