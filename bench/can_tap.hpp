#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"

namespace tether::bench {

/// The wall clock now, ns since 1970: the clock of the kernel's time stamps.
std::int64_t wall_ns();

/// A frame, and when the kernel received it (SO_TIMESTAMPNS), on wall_ns()'s clock.
struct StampedFrame {
  CanFrame frame;
  std::int64_t wall_ns = 0;
};

/// A raw CAN socket that hears all data frames with 11-bit identifiers on one interface, or only
/// those with the given identifiers, and may send. Throws std::system_error.
class CanTap {
 public:
  explicit CanTap(const std::string& interface, const std::vector<std::uint32_t>& ids = {});
  ~CanTap();
  CanTap(const CanTap&) = delete;
  CanTap& operator=(const CanTap&) = delete;

  int fd() const { return fd_; }
  void send(const CanFrame& frame) const;

  /// The next frame of another sender; nullopt if no frame comes within `timeout_ms` (0: does not
  /// wait).
  std::optional<StampedFrame> receive(int timeout_ms) const;

 private:
  int fd_;
};

}  // namespace tether::bench
