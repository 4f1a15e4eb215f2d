#pragma once

#include <cstdint>
#include <vector>

#include "common/bus/bus.hpp"
#include "common/bus/channel_names.hpp"
#include "common/loop/event_loop.hpp"
#include "common/onboard/onboard_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/surroundings.hpp"
#include "sim/lidar/lidar_model.hpp"
#include "sim/lidar/lidar_settings.hpp"
#include "sim/lidar/pose_track.hpp"

namespace tether {

using ScanSettings = Sections<RunSettings, WorldSettings, VehicleSettings, Surroundings,
                              LidarSettings, LocaliserSettings>;

/// The scanner's part of SimNode: AGV/SCAN, and with localiser.place = edge AGV/SCAN_PART, whenever
/// the last beam of a turn is measured. Turns begin at multiples of their period from t = 0 on, and
/// before.
class Scanning {
 public:
  /// The scanner must be on. `loop` and `bus` must outlive this.
  Scanning(const ScanSettings& settings, EventLoop& loop, Bus& bus);

  Duration period() const { return lidar_.period(); }
  /// From a turn's first beam to its last.
  Duration sweep() const { return lidar_.sweep(); }

  /// Where the vehicle was; times must ascend.
  void record(Instant when, const Pose2& pose) { track_.add(when, pose); }
  double range_max_m() const { return lidar_.range_max_m; }
  /// Publishes the turn whose last beam is measured at `end`. `others`: vehicles, as they are then.
  void publish_turn(Instant end, PlanName plan, std::vector<Shape> others = {});

 private:
  EventLoop& loop_;
  Bus& bus_;
  ChannelNames channels_;
  LidarSettings lidar_;
  Duration clock_offset_;
  MovingObstacles moving_;
  LidarModel model_;
  PoseTrack track_;
  bool in_parts_;
  std::size_t part_bytes_;
  std::int64_t part_seq_ = 0;
};

}  // namespace tether
