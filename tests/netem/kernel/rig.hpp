#pragma once

#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"
#include "netem/relay/make_links.hpp"

namespace tether::test {

// The kernel's random numbers cannot be seeded before Linux 6.6, so that each run is another one.
// A right channel fails in one of a million runs: each of 14 comparisons (loss ratio, bursts and
// gaps of four loss models, two laws of delay) has a 14th of that. A deliberate error of 20 % must
// be detected at that level, too.
inline constexpr double kFamilyLevel = 1e-6;
inline constexpr int kComparisons = 14;
inline constexpr double kLevel = kFamilyLevel / kComparisons;

/// Socket priorities 0 to 2 to tc's parents 1:1 to 1:3.
inline constexpr char kPriorities[] =
    "root handle 1: prio bands 3 priomap 0 1 2 2 2 2 2 2 2 2 2 2 2 2 2 2";

/// Our uplink; `keys` such as "loss=0.1", without "channel.uplink.".
inline Link our_link(const std::vector<std::string>& keys, std::uint64_t seed) {
  std::vector<std::string> overrides{"run.seed=" + std::to_string(seed)};
  for (const std::string& key : keys) overrides.push_back("channel.uplink." + key);
  return make_links(parse_scenario("", "test", overrides)).uplink;
}

}  // namespace tether::test
