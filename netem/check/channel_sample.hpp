#pragma once

#include <cstdint>
#include <vector>

#include "netem/check/link_expectation.hpp"
#include "netem/link/link.hpp"

namespace tether {

/// Fates of the first `count` packets of a link, and nothing else: no vehicle, no
/// controller. They are offered from t = 0 on as `traffic` says.
std::vector<PacketFate> sample_fates(Link& link, const LinkTraffic& traffic, std::int64_t count);

}  // namespace tether
