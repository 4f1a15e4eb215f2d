#include "can_bridge/agilex/config.hpp"

#include "can_bridge/agilex/v2.hpp"
#include "can_bridge/drivetrain/file.hpp"

namespace tether {

AgilexV2Config AgilexV2Config::read(const DrivetrainFile& file) {
  AgilexV2Config config;
  const TomlReader chassis =
      file.required_section("chassis", {"wheel_radius_m", "track_m"},
                            "a section [chassis] with wheel_radius_m and track_m");
  chassis.require("wheel_radius_m", "a number from 0.01 to 2");
  chassis.require("track_m", "a number from 0.05 to 10");
  chassis.number("wheel_radius_m", config.chassis_wheel_radius_m, 0.01, 2.0,
                 "of the driven wheels");
  chassis.number("track_m", config.chassis_track_m, 0.05, 10.0, "between wheel centres");
  const auto drives = file.section(
      "drives", {"feedback_timeout_ms", "boot_timeout_ms", "step_timeout_ms", "standstill_radps"});
  if (drives) {
    read_feedback_and_boot(*drives, config);
    read_step_and_standstill(*drives, config);
  }
  return config;
}

TransmitRules AgilexV2Config::transmit_rules() const {
  return {
      .frames = {{agilex::kMotionCommand, 0xFF}, {agilex::kModeCommand}, {agilex::kClearCommand}},
      .setpoints = {},
      .sdo_ids = {}};
}

}  // namespace tether
