#include "common/lockstep_loop.hpp"

#include <algorithm>
#include <cassert>
#include <stdexcept>
#include <utility>

namespace tether {

LockstepLoop::LockstepLoop(Instant start, std::int32_t rank) : now_(start), rank_(rank) {
  assert(rank >= 0 && rank < kFirstGrant);
  begin(rank);
}

void LockstepLoop::at(Instant when, Priority priority, Task task) {
  timers_.add(std::max(when, now_), priority, std::move(task));
}

void LockstepLoop::every(Instant first, Duration period, Priority priority, Task task) {
  timers_.add_periodic(TimerQueue::not_before(now_, first, period), period, priority,
                       std::move(task));
}

void LockstepLoop::add_fd(int, Task) {
  throw std::logic_error("simulated time has no file descriptors");
}

EventKey LockstepLoop::next() const {
  return timers_.empty() ? EventKey{} : EventKey{timers_.next(), timers_.next_order(), rank_};
}

void LockstepLoop::begin(std::int64_t grant) {
  first_ = first_insertion(grant);
  timers_.set_insertions(first_);
}

void LockstepLoop::add(Instant when, std::uint64_t order, Task task) {
  timers_.add_in_order(when, order, std::move(task));
}

void LockstepLoop::run_before(const EventKey& bound) {
  // The rest is for the next grant: there are 2^24 numbers, and others wait for a sign of life.
  constexpr std::uint64_t kMostInsertions = 1 << 20;
  bound_ = bound;
  while (!timers_.empty() && next() < bound_ && timers_.insertions() - first_ < kMostInsertions) {
    now_ = timers_.next();
    timers_.run_next();
  }
}

void LockstepLoop::limit(const EventKey& bound) { bound_ = std::min(bound_, bound); }

}  // namespace tether
