#include "common/loop/simulated_loop.hpp"

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

}  // namespace tether
