#include "common/loop/virtual_loop.hpp"

#include <algorithm>

namespace tether {

void VirtualLoop::run_until(Instant end) {
  stopped_ = false;
  while (!stopped_ && !timers_.empty() && timers_.next() <= end) {
    run_next();
  }
  if (!stopped_) now_ = std::max(now_, end);
}

}  // namespace tether
