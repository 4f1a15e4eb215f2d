#include "common/node/virtual_loop.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace tether {

void SimulatedLoop::at(Instant when, Priority priority, Task task) {
  timers_.add(std::max(when, now_), priority, std::move(task));
}

void SimulatedLoop::every(Instant first, Duration period, Priority priority, Task task) {
  timers_.add_periodic(TimerQueue::not_before(now_, first, period), period, priority,
                       std::move(task));
}

void SimulatedLoop::add_fd(int, Task) {
  throw std::logic_error("simulated time has no file descriptors");
}

void VirtualLoop::run_until(Instant end) {
  stopped_ = false;
  while (!stopped_ && !timers_.empty() && timers_.next() <= end) {
    run_next();
  }
  if (!stopped_) now_ = std::max(now_, end);
}

}  // namespace tether
