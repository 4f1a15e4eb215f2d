#pragma once

#include <sys/eventfd.h>
#include <unistd.h>

#include <cstdint>
#include <mutex>
#include <utility>
#include <vector>

#include "common/base/system_error.hpp"
#include "tools/view/session/hub.hpp"

namespace tether {

/// Clients' requests on their way to the program's loop, which watches fd().
class RequestBox {
 public:
  static constexpr std::size_t kMost = 1000;

  RequestBox()
      : fd_(check_system_call("making an eventfd", eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK))) {}
  ~RequestBox() { close(fd_); }
  RequestBox(const RequestBox&) = delete;
  RequestBox& operator=(const RequestBox&) = delete;

  int fd() const { return fd_; }

  /// False if there is no room.
  bool put(ViewRequest request) {
    const std::lock_guard lock(mutex_);
    if (waiting_.size() >= kMost) return false;
    waiting_.push_back(std::move(request));
    eventfd_write(fd_, 1);
    return true;
  }

  std::vector<ViewRequest> take() {
    const std::lock_guard lock(mutex_);
    eventfd_t count = 0;
    eventfd_read(fd_, &count);
    return std::exchange(waiting_, {});
  }

 private:
  std::mutex mutex_;
  int fd_;
  std::vector<ViewRequest> waiting_;
};

}  // namespace tether
