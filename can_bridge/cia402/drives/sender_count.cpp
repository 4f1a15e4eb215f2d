#include "can_bridge/cia402/drives/sender_count.hpp"

#include <algorithm>

namespace tether::cia402 {

void SenderCount::on_sync() {
  if (syncs_++ % every_ == 0) permits_ = std::min(permits_ + 1, kBacklog);
}

bool SenderCount::on_frame() {
  if (permits_ > 0) {
    --permits_;
    return true;
  }
  std::rotate(too_many_.begin(), too_many_.begin() + 1, too_many_.end());
  too_many_.back() = syncs_;
  return false;
}

bool SenderCount::two_sources() const {
  return too_many_.front() && syncs_ - *too_many_.front() < kWindow;
}

}  // namespace tether::cia402
