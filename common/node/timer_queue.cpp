#include "common/node/timer_queue.hpp"

#include <algorithm>
#include <cassert>
#include <utility>

namespace tether {
namespace {

constexpr auto kLater = [](const auto& a, const auto& b) { return b.is_before(a); };

}  // namespace

void TimerQueue::add(Instant when, Priority priority, Task task) {
  push(when, priority, allocate({std::move(task), Duration{0}, priority}));
}

void TimerQueue::add_periodic(Instant first, Duration period, Priority priority, Task task) {
  assert(period > Duration{0});
  push(first, priority, allocate({std::move(task), period, priority}));
}

void TimerQueue::add_in_order(Instant when, std::uint64_t order, Task task) {
  push_in_order(when, order, allocate({std::move(task), Duration{0}, Priority::delivery}));
}

Instant TimerQueue::not_before(Instant now, Instant first, Duration period) {
  if (first >= now) return first;
  return first + ((now - first + period - Duration{1}) / period) * period;
}

TimerQueue::Entry TimerQueue::take_front() {
  if (is_due_first()) {
    const Entry entry = due_[due_taken_++];
    if (due_taken_ == due_.size()) {
      due_.clear();
      due_taken_ = 0;
    }
    return entry;
  }
  std::pop_heap(heap_.begin(), heap_.end(), kLater);
  const Entry entry = heap_.back();
  heap_.pop_back();
  return entry;
}

void TimerQueue::run_next() {
  assert(!empty());
  const Entry entry = take_front();
  running_ = entry.when;

  // The task is moved out while it runs, because it may add tasks and so move the slots.
  Task task = std::move(slots_[entry.slot].task);
  try {
    task(entry.when);
  } catch (...) {
    free_slots_.push_back(entry.slot);
    throw;
  }
  Slot& slot = slots_[entry.slot];
  if (slot.period > Duration{0}) {
    slot.task = std::move(task);
    push(entry.when + slot.period, slot.priority, entry.slot);
  } else {
    free_slots_.push_back(entry.slot);
  }
}

void TimerQueue::push(Instant when, Priority priority, std::uint32_t slot) {
  push_in_order(when, order_of(priority, insertions_++), slot);
}

void TimerQueue::push_in_order(Instant when, std::uint64_t order, std::uint32_t slot) {
  const Entry entry{when, order, slot};
  if (when == running_ && (due_.empty() || due_.back().is_before(entry))) {
    due_.push_back(entry);
    return;
  }
  heap_.push_back(entry);
  std::push_heap(heap_.begin(), heap_.end(), kLater);
}

std::uint32_t TimerQueue::allocate(Slot slot) {
  if (free_slots_.empty()) {
    slots_.push_back(std::move(slot));
    return static_cast<std::uint32_t>(slots_.size() - 1);
  }
  const std::uint32_t index = free_slots_.back();
  free_slots_.pop_back();
  slots_[index] = std::move(slot);
  return index;
}

}  // namespace tether
