#pragma once

#include "common/scenario/scenario.hpp"

namespace tether {

/// [localiser]: what turns scans and odometry into poses (localiser/). Its keys are in
/// onboard/localiser/localiser_section.cpp; all sides of the loop have to know where it runs.
struct LocaliserSettings {
  /// none: poses come from [sensor], as from heaven. vehicle: poses go through the network. edge:
  /// scans do, in parts, and odometry; the controller's side localises.
  enum class Place { none, vehicle, edge };
  Place place = Place::none;
  bool knows_start = true;     ///< the start pose; false: it has to find out
  double resolution_m = 0.05;  ///< resolution of its map
  /// Height of the scanner above the floor; it sees only objects at this height.
  double scan_height_m = 0.2;
  double range_noise_m = 0.02;  ///< standard deviation of a beam
  /// Standard deviation of a wheel's travel after 1 m; grows as √.
  double odometry_noise_m = 0.005;
  /// Maximum distance from the map of a beam's end; others are ignored.
  double max_distance_m = 0.5;
  static constexpr int kLeastBeams = 20;  ///< minimum number of beams of a usable scan
  int max_beams = 1000;            ///< maximum number of matched beams of a scan, evenly chosen
  int particles = 20000;           ///< number of new particles per scan while it searches
  double scan_patience_ms = 30.0;  ///< place = edge: for missing parts after a scan's end
  double part_bytes = 1400.0;      ///< place = edge: of a part at most
};

/// [autonomy]: the vehicle drives by itself and asks for a remote driver when it cannot go on.
/// Its keys are in autonomy/node/autonomy_section.cpp.
struct AutonomySettings {
  bool enabled = false;
  double rate_hz = 50.0;           ///< rate of setpoints
  double deceleration_mps2 = 1.0;  ///< a of the stopping field v²/2a + v·reaction + margin
  double reaction_s = 0.2;
  double yaw_acceleration_radps2 = 2.0;  ///< limit of setpoints; v's is deceleration_mps2 both ways
  double margin_m = 0.3;                 ///< in front of the vehicle
  double side_margin_m = 0.15;           ///< beside it
  double wait_s = 3.0;            ///< in the protective stop, before a remote driver is asked for
  double clear_for_s = 1.0;       ///< before it goes on by itself
  double pose_timeout_s = 0.5;    ///< without a pose: localisation is lost
  double remote_timeout_s = 0.5;  ///< without a command of the remote driver: it stands
  /// Maximum age of the report that a remote driver's command names.
  double remote_max_age_s = 1.0;
  double remote_speed_mps = 0.5;  ///< at most, while it is driven remotely
};

inline bool has_localiser(const Scenario& scenario) {
  return scenario.get<LocaliserSettings>().place != LocaliserSettings::Place::none;
}

inline bool has_autonomy(const Scenario& scenario) {
  return scenario.get<AutonomySettings>().enabled;
}

}  // namespace tether
