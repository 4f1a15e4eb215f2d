#include "netem/check/channel_sample.hpp"

#include <algorithm>
#include <cstddef>

namespace tether {

std::vector<PacketFate> sample_fates(Link& link, const LinkTraffic& traffic, std::int64_t count) {
  std::vector<PacketFate> fates;
  fates.reserve(static_cast<std::size_t>(count));
  link.set_observer([&fates](const PacketFate& fate) { fates.push_back(fate); });
  const Duration period = std::max(Duration{1}, from_seconds(traffic.interval_s));
  const auto bytes = static_cast<std::size_t>(traffic.packet_bytes);
  for (std::int64_t i = 0; i < count; ++i) {
    const Instant now = kStart + i * period;
    link.push(now, {"", std::vector<std::uint8_t>(bytes)});
    link.pop_ready(now, [](const Packet&) {});
  }
  link.set_observer({});
  return fates;
}

}  // namespace tether
