#pragma once

#include <cstdint>

namespace tether {

struct RateSettings {
  double bits_per_s = 0.0;            ///< 0: no limit
  std::int64_t queue_packets = 1000;  ///< waiting or being sent; more are dropped
  std::int64_t queue_bytes = 0;       ///< the same in bytes, overhead included; 0: no limit
  std::int64_t overhead_bytes = 0;    ///< added to each packet's length; may be negative

  bool operator==(const RateSettings&) const = default;
};

}  // namespace tether
