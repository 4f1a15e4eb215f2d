#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "common/scenario/scenario.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/runs/run_observer.hpp"

// Every key that takes a number gets 0, −1, huge, tiny and undefined ones: each is refused under
// the key's name, or makes a run whose results are numbers.

namespace tether {
namespace {

using Overrides = std::vector<std::string>;

struct Base {
  std::string file;
  Overrides overrides;
};

const std::vector<Base>& bases() {
  static const std::vector<Base> kBases{
      {"paper.toml", {"vehicle.plant=kinematic"}},
      {"paper.toml",
       {"vehicle.plant=kinematic", "controller.law=mpc", "actuator.policy=horizon",
        "controller.estimator=ekf", "sensor.odometry_rate_hz=50", "channel.model=gilbert_elliott",
        "channel.gilbert_elliott.p=0.1", "channel.gilbert_elliott.r=0.5",
        "channel.jitter.law=normal", "channel.jitter.sd_ms=5", "tube.silence_s=0.5"}},
      {"paper_markov.toml", {"vehicle.plant=kinematic", "sensor.jumps_per_min=6"}},
      {"hil_vcan.toml", {}},
      {"factory_blocked.toml", {"vehicle.plant=kinematic"}},
      {"warehouse_wifi.toml", {"vehicle.plant=kinematic", "fleet.count=2"}}};
  return kBases;
}

/// "refused", or what went wrong; "" for a run whose results are numbers.
std::string outcome(const Base& base, const std::string& text) {
  Overrides overrides = base.overrides;
  overrides.emplace_back("run.duration_s=0.1");
  if (!text.empty()) overrides.push_back(text);
  try {
    const Scenario scenario = load_scenario(in_source("/scenarios/" + base.file), overrides);
    ClosedLoop loop(scenario);
    const FleetObserver observer(fleet_members(scenario), loop.loop(), loop.bus());
    loop.run();
    observer.check_finite();
    return "";
  } catch (const UsageError& e) {
    const bool is_one_line = std::string(e.what()).find('\n') == std::string::npos;
    return is_one_line ? "refused" : e.what();
  } catch (const std::exception& e) {
    return e.what();
  }
}

TEST(Numbers, OfEachKeyAreRefusedOrMakeARunOfNumbers) {
  for (const Base& base : bases()) ASSERT_EQ(outcome(base, ""), "");
  int keys = 0, tried = 0, refused = 0;
  for (const ScenarioSection& section : scenario_sections()) {
    for (const ScenarioKey& key : section.keys) {
      if (key.allowed.find("number") == std::string::npos) continue;
      ++keys;
      const bool is_list = key.allowed.find("list") != std::string::npos;
      for (const char* value : {"0", "-1", "1e308", "-1e308", "1e-308", "nan", "inf", "-inf"}) {
        const std::string text =
            key.name + "=" + (is_list ? std::string("[") + value + "]" : std::string(value));
        for (const Base& base : bases()) {
          const std::string how = outcome(base, text);
          ++tried;
          refused += how == "refused" ? 1 : 0;
          EXPECT_TRUE(how.empty() || how == "refused") << base.file << ", " << text << ": " << how;
        }
      }
    }
  }
  std::printf("measured: %d keys, %d values tried, %d refused\n", keys, tried, refused);
  EXPECT_GT(keys, 250);
}

}  // namespace
}  // namespace tether
