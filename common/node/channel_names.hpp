#pragma once

#include <string>
#include <string_view>

namespace tether {

/// The LCM channels of one vehicle's loop: the first part of a name says on which side of the
/// network it is. The default vehicle "AGV" has AGV/… on its side and CTRL/… on the controller's; a
/// vehicle "AGV7" has AGV7/… and CTRL7/…, SIM7/…, NET7/…, CAN7/…; any other name X has X/… and
/// CTRL-X/…, SIM-X/… and so on. The clock is all vehicles'.
struct ChannelNames {
  explicit ChannelNames(const std::string& vehicle) {
    const std::string suffix = vehicle.starts_with("AGV") ? vehicle.substr(3) : "-" + vehicle;
    vehicle_pose = vehicle + "/POSE";
    vehicle_command = vehicle + "/CMD_VEL";
    vehicle_plan = vehicle + "/PLAN";
    vehicle_preload = vehicle + "/PRELOAD";
    vehicle_odometry = vehicle + "/ODOMETRY";
    vehicle_scan = vehicle + "/SCAN";
    vehicle_scan_part = vehicle + "/SCAN_PART";
    vehicle_localisation = vehicle + "/LOCALISATION";
    localiser_counters = vehicle + "/LOCALISER_COUNTERS";
    vehicle_autonomy = vehicle + "/AUTONOMY";
    vehicle_drive = vehicle + "/DRIVE";
    autonomy_counters = vehicle + "/COUNTERS";
    control_pose = "CTRL" + suffix + "/POSE";
    control_odometry = "CTRL" + suffix + "/ODOMETRY";
    control_scan_part = "CTRL" + suffix + "/SCAN_PART";
    control_localisation = "CTRL" + suffix + "/LOCALISATION";
    control_autonomy = "CTRL" + suffix + "/AUTONOMY";
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
    const std::string sim = "SIM" + suffix, net = "NET" + suffix;
    wheel_states = sim + "/WHEELS";
    wheel_targets = sim + "/WHEEL_TARGETS";
    truth = sim + "/TRUTH";
    sim_counters = sim + "/COUNTERS";
    uplink_report = net + "/UPLINK";
    downlink_report = net + "/DOWNLINK";
    net_counters = net + "/COUNTERS";
    net_set = net + "/SET";
    net_settings = net + "/SETTINGS";
  }

  std::string vehicle_pose;
  std::string vehicle_odometry;
  std::string vehicle_scan;  ///< never leaves the vehicle; its parts do
  std::string vehicle_scan_part;
  std::string vehicle_localisation;
  std::string localiser_counters;  ///< wherever it runs
  std::string vehicle_autonomy;
  std::string vehicle_drive;  ///< autonomy → wheels: what the driver whose turn it is wants
  std::string autonomy_counters;
  std::string vehicle_command;
  std::string vehicle_plan;
  std::string vehicle_preload;  ///< never impaired
  std::string control_pose;
  std::string control_odometry;
  std::string control_scan_part;
  std::string control_localisation;
  std::string control_autonomy;
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
  std::string drive_counters;   ///< emulated drives' reports
  std::string wheel_states;     ///< simulator → emulated drives
  std::string wheel_targets;    ///< emulated drives → simulator
  std::string uplink_report;    ///< the relay's reports on poses …
  std::string downlink_report;  ///< and on commands
  std::string net_counters;
  std::string net_set;       ///< anybody → relay
  std::string net_settings;  ///< the relay's answers
  std::string truth;
  std::string sim_counters;
  static constexpr const char* kClock = "SIM/CLOCK";
  std::string clock = kClock;  ///< channel of all vehicles
};

/// The vehicle whose channel this is: "AGV7" for "CAN7/STATE" and "AGV7/COUNTERS".
inline std::string vehicle_of_channel(std::string_view channel) {
  const std::string_view side = channel.substr(0, channel.find('/'));
  for (const std::string_view of_vehicle : {"CAN", "CTRL", "SIM", "NET"}) {
    if (!side.starts_with(of_vehicle)) continue;
    const std::string_view rest = side.substr(of_vehicle.size());
    if (rest.starts_with('-')) return std::string(rest.substr(1));
    return "AGV" + std::string(rest);
  }
  return std::string(side);
}

}  // namespace tether
