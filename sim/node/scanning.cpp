#include "sim/node/scanning.hpp"

#include <algorithm>

#include "common/bus/message_io.hpp"
#include "common/onboard/scan.hpp"

namespace tether {

Scanning::Scanning(const ScanSettings& settings, EventLoop& loop, Bus& bus)
    : loop_(loop),
      bus_(bus),
      channels_(settings.get<VehicleSettings>().name),
      lidar_(settings.get<LidarSettings>()),
      clock_offset_(from_seconds(settings.get<VehicleSettings>().clock_offset_ms * 1e-3)),
      moving_(settings, settings.get<RunSettings>().seed),
      model_(lidar_, settings.get<VehicleSettings>(), standing_shapes(settings),
             settings.get<RunSettings>().seed, settings.get<VehicleSettings>().name),
      in_parts_(settings.get<LocaliserSettings>().place == LocaliserSettings::Place::edge),
      part_bytes_(static_cast<std::size_t>(settings.get<LocaliserSettings>().part_bytes)) {}

void Scanning::publish_turn(Instant end, PlanName plan, std::vector<Shape> others) {
  const Instant begin = end - sweep();
  for (Shape& shape : others) {  // to where it was at the begin
    shape.pose.x_m -= shape.vx_mps * to_seconds(sweep());
    shape.pose.y_m -= shape.vy_mps * to_seconds(sweep());
  }
  const std::vector<Shape>& moving = moving_.at(to_seconds(begin));
  others.insert(others.end(), moving.begin(), moving.end());
  Scan scan = model_.turn(begin, track_, others);
  track_.forget_before(end);
  scan.plan = plan;
  scan.stamp += clock_offset_;
  publish(bus_, channels_.vehicle_scan, scan_message(scan, loop_.run_id()));
  if (!in_parts_) return;
  const double step_m = std::max({lidar_.range_step_m, lidar_.range_max_m / kMostRangeSteps, 1e-3});
  for (const scan_part_t& part : scan_parts(scan, loop_.run_id(), part_seq_, part_bytes_, step_m)) {
    publish(bus_, channels_.vehicle_scan_part, part);
    ++part_seq_;
  }
}

}  // namespace tether
