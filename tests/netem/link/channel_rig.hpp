#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "common/base/errors.hpp"
#include "netem/relay/live_settings.hpp"
#include "netem/relay/make_links.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether::test {

using Settings = std::vector<std::string>;

/// Both links of a scenario, with the means to change their settings.
struct ChannelRig {
  explicit ChannelRig(const Scenario& scenario) : ChannelRig(scenario, make_models(scenario)) {}
  ChannelRig(const Scenario& scenario, const ChannelModels& models)
      : links(make_links(scenario, models)), control(scenario, models) {}

  std::vector<ChannelSetting> change(const Settings& settings, Instant now) {
    return control.change(settings, now, {&links.uplink, &links.downlink});
  }
  /// The reason why it is refused; "accepted" if it is not.
  std::string refusal(const Settings& settings, Instant now = kStart) {
    return refusal_of([&] { change(settings, now); });
  }

  LinkPair links;
  ChannelControl control;
};

/// A scenario with these settings of the channel ("uplink.prr=0.5").
inline Scenario channel(const Settings& settings, const Settings& others = {}) {
  Settings keys = others;
  for (const std::string& text : settings) keys.push_back("channel." + text);
  return parse_scenario("", "test.toml", keys);
}

/// Other settings before packet number `before`.
struct ChangeAt {
  int before;
  Settings settings;
};

/// The fates of packets of 50 bytes, one every millisecond, at the uplink. Each change comes at the
/// time of its packet.
inline std::vector<PacketFate> uplink_fates(const Settings& start,
                                            const std::vector<ChangeAt>& changes = {},
                                            int packets = 3000) {
  ChannelRig rig(channel(start));
  std::vector<PacketFate> fates;
  rig.links.uplink.set_observer([&fates](const PacketFate& fate) { fates.push_back(fate); });
  for (int i = 0; i < packets; ++i) {
    for (const ChangeAt& c : changes) {
      if (c.before == i) rig.change(c.settings, at_ms(i));
    }
    rig.links.uplink.push(at_ms(i), {"X", std::vector<std::uint8_t>(50)});
    rig.links.uplink.pop_ready(at_ms(i), [](const Packet&) {});
  }
  return fates;
}

inline bool same(const PacketFate& a, const PacketFate& b) {
  return a.number == b.number && a.outcome == b.outcome && a.departure == b.departure &&
         a.state == b.state && a.corrupted == b.corrupted && a.duplicated == b.duplicated &&
         a.reordered == b.reordered;
}

/// Expects the fates of packets from `first` to before `last` to be the same.
inline void expect_same(const std::vector<PacketFate>& a, const std::vector<PacketFate>& b,
                        std::size_t first, std::size_t last) {
  ASSERT_GE(a.size(), last);
  ASSERT_GE(b.size(), last);
  for (std::size_t n = first; n < last; ++n) ASSERT_TRUE(same(a[n], b[n])) << "packet " << n;
}

/// How many packets of these have another fate.
inline int different(const std::vector<PacketFate>& a, const std::vector<PacketFate>& b,
                     std::size_t first, std::size_t last) {
  int count = 0;
  for (std::size_t n = first; n < last; ++n) count += same(a[n], b[n]) ? 0 : 1;
  return count;
}

}  // namespace tether::test
