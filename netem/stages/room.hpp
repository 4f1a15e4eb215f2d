#pragma once

#include <cstdint>

namespace tether {

struct RoomSettings {
  std::int64_t packets = 100'000;  ///< under way; more are dropped
  std::int64_t bytes = 1LL << 28;  ///< the same in bytes of payload

  bool operator==(const RoomSettings&) const = default;
};

}  // namespace tether
