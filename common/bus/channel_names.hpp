#pragma once

#include <string>

namespace tether {

/// The LCM channels of one vehicle's loop: the first part of a name says on which side of the
/// network it is. The default vehicle "AGV" has AGV/… on its side and CTRL/… on the controller's; a
/// vehicle "AGV7" has AGV7/… and CTRL7/…; any other name X has X/… and CTRL-X/….
struct ChannelNames {
  explicit ChannelNames(const std::string& vehicle) {
    const std::string suffix = vehicle.starts_with("AGV") ? vehicle.substr(3) : "-" + vehicle;
    vehicle_pose = vehicle + "/POSE";
    vehicle_command = vehicle + "/CMD_VEL";
    vehicle_plan = vehicle + "/PLAN";
    vehicle_preload = vehicle + "/PRELOAD";
    vehicle_odometry = vehicle + "/ODOMETRY";
    control_pose = "CTRL" + suffix + "/POSE";
    control_odometry = "CTRL" + suffix + "/ODOMETRY";
    control_command = "CTRL" + suffix + "/CMD_VEL";
    control_plan = "CTRL" + suffix + "/PLAN";
    control_preload = "CTRL" + suffix + "/PRELOAD";
    control_report = "CTRL" + suffix + "/REPORT";
    control_counters = "CTRL" + suffix + "/COUNTERS";
    const std::string can = "CAN" + suffix;
    can_request = can + "/REQUEST";
    can_inject = can + "/INJECT";
    can_state = can + "/STATE";
    can_wheels = can + "/WHEELS";
    can_odometry = can + "/ODOMETRY";
    can_plan = can + "/PLAN";
    can_counters = can + "/COUNTERS";
    drive_counters = can + "/DRIVE_COUNTERS";
  }

  std::string vehicle_pose;
  std::string vehicle_odometry;
  std::string vehicle_command;
  std::string vehicle_plan;
  std::string vehicle_preload;  ///< never impaired
  std::string control_pose;
  std::string control_odometry;
  std::string control_command;
  std::string control_plan;
  std::string control_preload;  ///< never impaired
  std::string control_report;
  std::string control_counters;
  std::string can_request;  ///< operator → bridge
  std::string can_inject;   ///< tester → emulated drives
  std::string can_state;    ///< bridge's reports …
  std::string can_wheels;
  std::string can_odometry;
  std::string can_plan;  ///< bridge → sensor: the plan in force
  std::string can_counters;
  std::string drive_counters;                       ///< emulated drives' reports
  std::string wheel_states = "SIM/WHEELS";          ///< simulator → emulated drives
  std::string wheel_targets = "SIM/WHEEL_TARGETS";  ///< emulated drives → simulator
  std::string uplink_report = "NET/UPLINK";
  std::string downlink_report = "NET/DOWNLINK";
  std::string net_counters = "NET/COUNTERS";
  std::string net_set = "NET/SET";            ///< anybody → relay
  std::string net_settings = "NET/SETTINGS";  ///< the relay's answers
  std::string clock = "SIM/CLOCK";
  std::string truth = "SIM/TRUTH";
  std::string sim_counters = "SIM/COUNTERS";
};

}  // namespace tether
