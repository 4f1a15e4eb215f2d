#include "common/lcm/lockstep_loop.hpp"

#include <algorithm>
#include <cassert>
#include <utility>

namespace tether {

LockstepLoop::LockstepLoop(Instant start, std::int32_t rank) : SimulatedLoop(start), rank_(rank) {
  assert(rank >= 0 && rank < kFirstGrant);
  begin(rank);
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
  // After so many insertions the rest waits for the next grant: a grant has only 2^24 numbers, and
  // the coordinator waits for a sign of life.
  constexpr std::uint64_t kMostInsertions = 1 << 20;
  bound_ = bound;
  while (!timers_.empty() && next() < bound_ && timers_.insertions() - first_ < kMostInsertions) {
    run_next();
  }
}

void LockstepLoop::limit(const EventKey& bound) { bound_ = std::min(bound_, bound); }

}  // namespace tether
