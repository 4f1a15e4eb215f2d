#include "common/path/controlled_point.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;

Scenario parse(const std::vector<std::string>& overrides) {
  return parse_scenario("", "test.toml", overrides);
}

TEST(ControlledPoint, PathsPutItOnTheirStart) {
  const Scenario s = parse(
      {"path.kind=line", "path.start_x_m=-5", "path.start_yaw_rad=0.5", "path.point=chassis"});
  const auto& vehicle = s.get<VehicleSettings>();
  const Position point = point_ahead({vehicle.start_x_m, vehicle.start_y_m, vehicle.start_yaw_rad},
                                     controlled_point_ahead_m(s.get<PathSettings>(), vehicle));
  EXPECT_NEAR(point.x_m, -5.0, 1e-12);
  EXPECT_NEAR(point.y_m, 0.0, 1e-12);
}

TEST(ControlledPoint, OfAVehicleWithItsAxleInFrontIsRefused) {
  for (const char* axle : {"vehicle.axle_x_m=0.3", "vehicle.axle_x_m=0"}) {
    try {
      parse({"path.point=chassis", axle});
      FAIL() << axle;
    } catch (const UsageError& error) {
      EXPECT_THAT(error.what(), HasSubstr("path.point = \"chassis\""));
      EXPECT_THAT(error.what(), HasSubstr("vehicle.axle_x_m"));
    }
    EXPECT_NO_THROW(parse({"path.point=axle", axle}));
  }
}

}  // namespace
}  // namespace tether
