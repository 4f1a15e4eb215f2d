#pragma once

#include <cstdint>
#include <string>

namespace tether {

/// A UDP port of this host that nobody used, and that nobody who asks the system for a free one
/// gets until this is gone. Who asks for it by its number, as LCM networks do, shares it.
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
