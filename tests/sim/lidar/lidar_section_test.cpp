#include <gtest/gtest.h>

#include "common/base/errors.hpp"
#include "common/scenario/scenario.hpp"
#include "sim/sensor/lidar_settings.hpp"

namespace tether {
namespace {

Scenario parsed(const std::string& toml, const std::vector<std::string>& overrides = {}) {
  return parse_scenario(toml, "test.toml", overrides);
}

std::string refusal(const std::vector<std::string>& overrides) {
  try {
    parsed("", overrides);
  } catch (const UsageError& error) {
    return error.what();
  }
  return "";
}

TEST(LidarSection, IsOffAndLeavesNoTraceByDefault) {
  const Scenario scenario = parsed("");
  EXPECT_FALSE(scenario.get<LidarSettings>().on());
  EXPECT_EQ(to_toml(scenario).find("lidar"), std::string::npos);
}

TEST(LidarSection, APresetSetsWhatIsNotGiven) {
  const LidarSettings preset = lidar_preset("sick_lms111");
  const Scenario scenario =
      parsed("[lidar]\nmodel = 'sick_lms111'\nrate_hz = 25", {"lidar.noise_m=0.02"});
  const auto& lidar = scenario.get<LidarSettings>();
  EXPECT_EQ(lidar.rate_hz, 25.0);
  EXPECT_EQ(lidar.noise_m, 0.02);
  EXPECT_EQ(lidar.divergence_rad, preset.divergence_rad);
  EXPECT_EQ(lidar.range_10_m, preset.range_10_m);
  EXPECT_EQ(lidar.beams, 541);
}

TEST(LidarSection, ResolvesToWhatGivesTheSameAgain) {
  for (const std::string& model : lidar_presets()) {
    const Scenario once = parsed("", {"lidar.model=" + model, "lidar.range_max_m=7.5"});
    const std::string text = to_toml(once);
    EXPECT_EQ(to_toml(parsed(text)), text);
  }
}

TEST(LidarSection, EachPresetIsAScannerThatFits) {
  for (const std::string& model : lidar_presets()) {
    EXPECT_EQ(refusal({"lidar.model=" + model}), "") << model;
    EXPECT_EQ(lidar_preset(model).model, model);
  }
}

TEST(LidarSection, RefusesInOneLineWithKeyAndWhatIsAllowed) {
  using ::testing::HasSubstr;
  EXPECT_THAT(refusal({"lidar.model=hokuyo"}),
              ::testing::AllOf(HasSubstr("lidar.model"), HasSubstr("sick_nanoscan3"),
                               HasSubstr("sick_lms111"), HasSubstr("none")));
  EXPECT_THAT(refusal({"lidar.model=custom", "lidar.beams=0"}), HasSubstr("lidar.beams"));
  EXPECT_THAT(refusal({"lidar.model=custom", "lidar.beams=8193"}),
              HasSubstr("lidar.beams = 8193 must be a whole number from 1 to 8192"));
  EXPECT_THAT(refusal({"lidar.model=custom", "lidar.rate_hz=200", "world.step_ms=10"}),
              HasSubstr("lidar.rate_hz = 200"));
  EXPECT_THAT(refusal({"lidar.model=custom", "lidar.range_min_m=30"}),
              HasSubstr("lidar.range_min_m = 30 must be below"));
  EXPECT_THAT(refusal({"lidar.model=custom", "lidar.mount_x_m=0.2"}),
              HasSubstr("nothing but its own vehicle"));
  EXPECT_THAT(refusal({"lidar.model=custom", "lidar.mount_x_m=0.2", "lidar.height_m=0"}),
              HasSubstr("lidar.height_m"));
  EXPECT_THAT(refusal({"lidar.rate_hz=10"}), HasSubstr("lidar.model"))
      << "a key of what is switched off";
}

TEST(LidarSection, RefusesAScannerThatStartsInAnObstacle) {
  const std::string toml =
      "[lidar]\nmodel = 'custom'\nmount_x_m = 2.5\n"
      "[[world.obstacle]]\nkind = 'box'\nx_m = 2.6\ny_m = 0\nlength_m = 0.5\nwidth_m = 0.5\n"
      "height_m = 0.25\nmapped = false\n";
  EXPECT_NO_THROW(parsed(toml, {"lidar.height_m=0.3"}));
  EXPECT_THROW(parsed(toml, {"lidar.height_m=0.2"}), UsageError);
}

TEST(LidarSection, MayStandFarOutsideItsVehicleButNotOutsideTheHall) {
  using ::testing::HasSubstr;
  EXPECT_EQ(refusal({"lidar.model=custom", "lidar.mount_x_m=5"}), "");
  EXPECT_THAT(refusal({"lidar.model=custom", "lidar.mount_x_m=30"}),
              HasSubstr("test.toml: the scanner starts at (30.00, 0.00) m, in or beyond a wall: "
                        "lidar.mount_x_m = 30, mount_y_m = 0 must have it within ±22 m"));
  EXPECT_THAT(refusal({"lidar.model=custom", "lidar.mount_y_m=-23"}), HasSubstr("beyond a wall"));
  EXPECT_THAT(refusal({"lidar.model=custom", "lidar.mount_y_m=15", "vehicle.start_yaw_rad=1.5708",
                       "vehicle.start_x_m=-10"}),
              HasSubstr("the scanner starts at (-25.00, "));
}

}  // namespace
}  // namespace tether
