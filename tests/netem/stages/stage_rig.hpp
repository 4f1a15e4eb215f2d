#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "netem/channel/settings.hpp"
#include "netem/models/state_process.hpp"
#include "netem/stages/kinds.hpp"

namespace tether::test {

/// A link with these stages ("jitter.law=normal"), whose channel is always in one condition.
inline Link link_with(const std::vector<std::string>& settings, LinkCondition condition = {}) {
  std::vector<std::string> keys;
  for (const std::string& setting : settings) keys.push_back("channel.uplink." + setting);
  const Scenario scenario = parse_scenario("", "test.toml", keys);
  const LinkConfig& link = scenario.get<ChannelSettings>().uplink;
  const auto streams = [](std::string_view purpose) { return random_stream(1, purpose); };
  return {make_stages(link, "", streams), std::make_shared<FixedProcess>(condition)};
}

/// The first bytes of the packets that leave a link by `now`.
inline std::vector<int> pop(Link& link, Instant now) {
  std::vector<int> values;
  link.pop_ready(now, [&values](const Packet& p) { values.push_back(p.bytes.front()); });
  return values;
}

inline void expect_balance(const Link& link) {
  const Link::Counters& c = link.counters();
  EXPECT_EQ(c.offered + c.duplicated,
            c.outage_dropped + c.lost + c.overflowed + c.delivered + link.in_flight());
}

}  // namespace tether::test
