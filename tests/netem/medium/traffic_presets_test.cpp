#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/base/errors.hpp"
#include "common/scenario/scenario.hpp"
#include "netem/medium/medium_section.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;
using Kind = MediumSettings::Background::Kind;

Scenario with(const std::string& background) {
  return parse_scenario(
      "[medium]\nmodel = \"dcf\"\nqueue = 1000\n[[medium.background]]\n" + background, "test.toml",
      {});
}

MediumSettings::Background background(const std::string& text) {
  return with(text).get<MediumSettings>().background.at(0);
}

std::string refusal(const std::string& text) {
  return refusal_of([&] { with(text); });
}

TEST(TrafficPresets, SetWhatTheirRowHas) {
  for (const TrafficPreset& preset : kTrafficPresets) {
    const auto b = background(std::string("preset = \"") + preset.name + "\"");
    EXPECT_EQ(b.kind, preset.kind) << preset.name;
    EXPECT_EQ(b.rate_hz, preset.rate_hz) << preset.name;
    EXPECT_EQ(b.bytes, preset.bytes) << preset.name;
  }
}

// Bit rates of the table of aperiodic services.
TEST(TrafficPresets, OfBitRatesHaveThese) {
  const auto Mbps = [](const char* name) {
    const TrafficPreset* preset = traffic_preset(name);
    return 8e-6 * preset->rate_hz * static_cast<double>(preset->bytes);
  };
  EXPECT_NEAR(Mbps("video_streaming"), 10.0, 0.01);
  EXPECT_DOUBLE_EQ(Mbps("emergency_stop"), 0.25);
}

TEST(TrafficPresets, AreBeatenByWhatIsGivenBesideThem) {
  const auto b = background(
      "preset = \"video_remote_control\"\nrate_hz = 100\nstations = 3\ncategory = \"VI\"");
  EXPECT_EQ(b.rate_hz, 100.0);
  EXPECT_EQ(b.bytes, 15'000);
  EXPECT_EQ(b.stations, 3);
  EXPECT_EQ(b.category, "VI");
}

TEST(TrafficPresets, AreNumbersInTheResolvedScenario) {
  const std::string resolved = to_toml(with("preset = \"machine_control\""));
  EXPECT_THAT(resolved, HasSubstr("kind = \"periodic\"\nstations = 1\nbytes = 250"));
  EXPECT_EQ(to_toml(parse_scenario(resolved, "resolved.toml", {})), resolved);
}

TEST(TrafficPresets, OfOtherNamesAreRefusedWithThoseThatThereAre) {
  EXPECT_THAT(refusal("preset = \"video\""), HasSubstr("medium.background"));
  for (const TrafficPreset& preset : kTrafficPresets) {
    EXPECT_THAT(refusal("preset = \"video\""), HasSubstr(preset.name));
  }
  EXPECT_THAT(refusal("preset = 3"), HasSubstr("machine_control"));
  EXPECT_THAT(refusal("preset = \"machine_control\"\nkind = \"saturated\""),
              HasSubstr("nor a preset"));
}

}  // namespace
}  // namespace tether
