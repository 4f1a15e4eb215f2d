#pragma once

#include <cstdint>
#include <string>

namespace tether {

/// A UDP port of this host that was free, and that the system does not hand out as free until this
/// is gone. Programs that bind it by its number, as LCM networks do, share it.
class ReservedPort {
 public:
  /// Throws std::system_error if there is none.
  ReservedPort();
  ~ReservedPort();
  ReservedPort(const ReservedPort&) = delete;
  ReservedPort& operator=(const ReservedPort&) = delete;

  /// An LCM network on it that does not leave the host.
  std::string lcm_url() const;

 private:
  int fd_;
  std::uint16_t port_ = 0;
};

}  // namespace tether
