#pragma once

#include <string>

namespace tether {

/// The LCM channels of one vehicle's loop: the first part says on which side of the network you
/// are. The default vehicle "AGV" has AGV/… on its side and CTRL/… on the controller's; a vehicle
/// "AGV7" has AGV7/… and CTRL7/…; any other name X has X/… and CTRL-X/….
struct ChannelNames {
  explicit ChannelNames(const std::string& vehicle) {
    const std::string suffix = vehicle.starts_with("AGV") ? vehicle.substr(3) : "-" + vehicle;
    vehicle_pose = vehicle + "/POSE";
    vehicle_command = vehicle + "/CMD_VEL";
    control_pose = "CTRL" + suffix + "/POSE";
    control_command = "CTRL" + suffix + "/CMD_VEL";
    control_report = "CTRL" + suffix + "/REPORT";
    control_counters = "CTRL" + suffix + "/COUNTERS";
  }

  std::string vehicle_pose;
  std::string vehicle_command;
  std::string control_pose;
  std::string control_command;
  std::string control_report;
  std::string control_counters;
  std::string uplink_report = "NET/UPLINK";
  std::string downlink_report = "NET/DOWNLINK";
  std::string net_counters = "NET/COUNTERS";
  std::string clock = "SIM/CLOCK";
  std::string truth = "SIM/TRUTH";
  std::string sim_counters = "SIM/COUNTERS";
};

}  // namespace tether
