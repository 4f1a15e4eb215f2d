#pragma once

namespace tether {

struct DuplicateSettings {
  double probability = 0.0;  ///< probability that a packet is sent twice

  bool operator==(const DuplicateSettings&) const = default;
};

}  // namespace tether
