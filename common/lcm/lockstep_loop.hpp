#pragma once

#include <cstdint>

#include "common/node/timer_queue.hpp"
#include "common/node/virtual_loop.hpp"

namespace tether {

/// Simulated time of one node in lockstep with others: events run in the order that they have in
/// one VirtualLoop for all nodes, as far as a coordinator's grants allow (docs/reference/time.md).
class LockstepLoop final : public SimulatedLoop {
 public:
  /// `rank`: the node's place among the nodes, from 0 and below kFirstGrant.
  LockstepLoop(Instant start, std::int32_t rank);

  /// The grant ends after the current event.
  void stop() override { bound_ = EventKey{Instant::min(), 0, 0}; }

  /// The next event.
  EventKey next() const;

  /// Assigns all events scheduled from now on to this grant.
  void begin(std::int64_t grant);
  /// Adds an event whose place in the order is given: the delivery of a message.
  void add(Instant when, std::uint64_t order, Task task);
  /// Runs the events before `bound`. Ends earlier after stop(), and after very many events.
  void run_before(const EventKey& bound);
  /// Called within run_before(), which then goes no further than to `bound`.
  void limit(const EventKey& bound);
  /// Takes a number for an event that happens elsewhere: counts from 0 with each grant.
  std::uint64_t take_index() { return timers_.take_insertion() - first_; }
  /// The place in the order at which a message is delivered that got this number under this grant.
  std::uint64_t delivery_order(std::uint64_t index) const {
    return TimerQueue::order_of(Priority::delivery, first_ + index);
  }
  /// The run is over, at this time.
  void set_now(Instant now) { now_ = now; }

 private:
  std::int32_t rank_;
  EventKey bound_;
  std::uint64_t first_ = 0;  // first of this grant's insertions
};

}  // namespace tether
