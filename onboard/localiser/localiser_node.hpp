#pragma once

#include <cstdint>
#include <string>
#include <tether/odometry_t.hpp>

#include "common/node/bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/counter_reporter.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/message_io.hpp"
#include "common/node/node.hpp"
#include "common/node/sole_sender.hpp"
#include "common/node/stream_guard.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/onboard_settings.hpp"
#include "common/world/scan.hpp"
#include "common/world/surroundings.hpp"
#include "onboard/localiser/localiser.hpp"

namespace tether {

/// The scenario sections that the localiser uses.
using LocaliserNodeSettings =
    Sections<RunSettings, WorldSettings, VehicleSettings, Surroundings, LocaliserSettings>;

/// Turns scans and odometry into poses. localiser.place = "vehicle": AGV/SCAN and AGV/ODOMETRY in,
/// AGV/POSE and AGV/LOCALISATION out. "edge": CTRL/SCAN_PART and CTRL/ODOMETRY in, CTRL/POSE and
/// CTRL/LOCALISATION out.
///
/// Each scan gives a localisation, and unless it is searching a pose: that at the scan's end, with
/// the plan that the scan names. While it searches, and without scans, there is no pose, so that
/// controller.pose_timeout_s stops the vehicle. Parts of a scan are put together (ScanAssembly);
/// what is missing localiser.scan_patience_ms after its end is not waited for.
///
/// Messages that are undecodable, not usable, duplicated, late, stamped in the future or of another
/// run are counted and change nothing.
class LocaliserNode final : public Node {
 public:
  /// Throws UsageError for a map that cannot be read or takes too much memory.
  LocaliserNode(const LocaliserNodeSettings& settings, EventLoop& loop, Bus& bus);

  /// Publishes the final counters.
  void finish() override;

 private:
  void listen_on_vehicle(Bus& bus);
  void listen_at_edge(Bus& bus);
  void on_odometry(const odometry_t& message);
  void on_part(const scan_part_t& message);
  void on_overdue();
  void on_scan(const Scan& scan);
  void publish_pose(const Localisation& found, const PlanName& plan);
  void publish_localisation(const Localisation& found);
  void list_counters(CounterList& out) const;

  EventLoop& loop_;
  Bus& bus_;
  bool at_edge_;
  ChannelNames channels_;
  SoleSender senders_;
  Localiser localiser_;
  ScanAssembly assembly_;
  StreamGuard scan_guard_;  ///< guards scans, or their parts
  StreamGuard odometry_guard_;
  Rejected rejected_scans_;
  std::int64_t unusable_scans_ = 0;
  std::int64_t backward_scans_ = 0;
  std::int64_t undecodable_odometry_ = 0;
  std::int64_t unusable_odometry_ = 0;
  std::optional<Instant> last_end_;  ///< end of the last scan
  std::int64_t poses_ = 0;
  std::int64_t localisations_ = 0;
  CounterReporter counters_;
};

}  // namespace tether
