#include <gtest/gtest.h>

#include <tether/autonomy_state_t.hpp>
#include <tether/counters_t.hpp>
#include <tether/localisation_t.hpp>
#include <tether/scan_part_t.hpp>

#include "netem/relay/netem_node.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::Seen;
using test::VirtualWorld;

struct Relayed {
  std::vector<std::int64_t> poses;
  std::map<std::string, std::vector<std::int64_t>> companions;  ///< by what CTRL/… they came on
  std::map<std::string, std::int64_t> offered;                  ///< by counter
};

/// 60 s of poses at 10 Hz, and if wanted what goes beside them.
Relayed relayed(bool with_companions) {
  const Scenario scenario = parse_scenario("", "test.toml", {"channel.prr=0.5"});
  VirtualWorld world;
  std::vector<Seen<pose_t>> poses;
  std::vector<Seen<scan_part_t>> parts;
  std::vector<Seen<localisation_t>> localisations;
  std::vector<Seen<autonomy_state_t>> states;
  std::vector<Seen<counters_t>> counters;
  world.collect("CTRL/POSE", poses);
  world.collect("CTRL/SCAN_PART", parts);
  world.collect("CTRL/LOCALISATION", localisations);
  world.collect("CTRL/AUTONOMY", states);
  world.collect("NET/COUNTERS", counters);
  NetemNode node(scenario, world.loop, world.bus, world.bus);
  for (int i = 0; i < 600; ++i) {
    world.publish_at(at_ms(100 * i), "AGV/POSE", test::pose(at_ms(100 * i), i));
    if (!with_companions) continue;
    scan_part_t part{};
    localisation_t localisation{};
    autonomy_state_t state{};
    part.seq = localisation.seq = state.seq = i;
    world.publish_at(at_ms(100 * i), "AGV/SCAN_PART", part);
    world.publish_at(at_ms(100 * i), "AGV/LOCALISATION", localisation);
    world.publish_at(at_ms(100 * i), "AGV/AUTONOMY", state);
  }
  world.loop.run_until(at_s(70));
  node.finish();
  world.loop.run_until(at_s(70));
  Relayed out;
  const auto note = [](const auto& seen, std::vector<std::int64_t>& numbers) {
    for (const auto& m : seen) numbers.push_back(m.message.seq);
  };
  note(poses, out.poses);
  note(parts, out.companions["SCAN_PART"]);
  note(localisations, out.companions["LOCALISATION"]);
  note(states, out.companions["AUTONOMY"]);
  for (const std::string name : {"scan_part", "localisation", "autonomy"}) {
    out.offered[name] = test::counter(counters.back().message, name + ".offered");
  }
  return out;
}

TEST(WhatGoesBesidePoses, LeavesTheirFateAlone) {
  const Relayed with = relayed(true), without = relayed(false);
  EXPECT_EQ(with.poses, without.poses);
  for (const auto& [name, offered] : with.offered) EXPECT_EQ(offered, 600) << name;
  for (const auto& [name, offered] : without.offered) EXPECT_EQ(offered, -1) << name;
}

TEST(WhatGoesBesidePoses, HasLuckOfItsOwnEach) {
  const Relayed r = relayed(true);
  std::vector<std::vector<std::int64_t>> all{r.poses};
  for (const auto& [name, numbers] : r.companions) {
    // Binomial: 300 ± 12.2; four of them.
    EXPECT_NEAR(static_cast<double>(numbers.size()), 300, 4 * 12.2) << name;
    for (const auto& other : all) {
      std::vector<std::int64_t> both;
      std::set_intersection(numbers.begin(), numbers.end(), other.begin(), other.end(),
                            std::back_inserter(both));
      // Both got through: 600 · 0.25 = 150 ± 10.6 if they are independent.
      EXPECT_NEAR(static_cast<double>(both.size()), 150, 4 * 10.6) << name;
    }
    all.push_back(numbers);
  }
}

}  // namespace
}  // namespace tether
