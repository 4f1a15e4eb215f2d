#include "common/virtual_loop.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace tether {

void VirtualLoop::at(Instant when, Priority priority, Task task) {
  timers_.add(std::max(when, now_), priority, std::move(task));
}

void VirtualLoop::every(Instant first, Duration period, Priority priority, Task task) {
  timers_.add_periodic(TimerQueue::not_before(now_, first, period), period, priority,
                       std::move(task));
}

void VirtualLoop::add_fd(int, Task) {
  throw std::logic_error("virtual time has no file descriptors");
}

void VirtualLoop::run_until(Instant end) {
  stopped_ = false;
  while (!stopped_ && !timers_.empty() && timers_.next() <= end) {
    now_ = timers_.next();
    timers_.run_next();
  }
  if (!stopped_) now_ = std::max(now_, end);
}

}  // namespace tether
