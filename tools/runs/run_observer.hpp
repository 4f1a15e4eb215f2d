#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <tether/autonomy_state_t.hpp>
#include <tether/counters_t.hpp>
#include <tether/ground_truth_t.hpp>
#include <tether/link_report_t.hpp>
#include <vector>

#include "common/bus/bus.hpp"
#include "common/bus/stream_guard.hpp"
#include "common/loop/event_loop.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/can/drivetrain_observer.hpp"

namespace tether {

/// One row of trajectory.csv.
struct TrajectoryRow {
  double t_s, x_m, y_m, yaw_rad, x_ref_m, y_ref_m, error_m;
  int uplink_state, downlink_state;  ///< last reported state: 0 good, 1 bad
};

/// Watches a run on the bus, the same way in virtual and in real time, and keeps what its summary
/// and figures need. A restarted simulator restarts the trajectory.
class RunObserver {
 public:
  RunObserver(const Scenario& scenario, EventLoop& loop, Bus& bus);
  RunObserver(const RunObserver&) = delete;
  RunObserver& operator=(const RunObserver&) = delete;

  /// Newest messages; all zero before the first.
  const ground_truth_t& truth() const { return truth_; }
  const link_report_t& uplink() const { return uplink_; }
  const link_report_t& downlink() const { return downlink_; }
  /// "node.counter" → value, as last reported; and what this observer itself could not decode
  /// ("observer.undecodable") or would not believe ("observer.rejected": duplicated, late,
  /// non-finite truth or link reports).
  std::map<std::string, std::int64_t> counters() const;
  /// One that was reported; 0 before.
  std::int64_t counter(const std::string& name) const {
    const auto found = counters_.find(name);
    return found == counters_.end() ? 0 : found->second;
  }

  const std::vector<TrajectoryRow>& trajectory() const { return trajectory_; }

  /// Reports of the CAN bridge; nullopt with a direct drivetrain.
  const std::optional<DrivetrainObserver>& drivetrain() const { return drivetrain_; }

  /// The newest report of a vehicle that drives by itself; nullopt with autonomy.enabled = false.
  const std::optional<autonomy_state_t>& autonomy() const { return autonomy_; }

  std::int64_t poses_received() const { return poses_received_; }
  /// Twists and plans that reached the vehicle.
  std::int64_t commands_received() const { return commands_received_; }

  /// Time-mean, since t = 0, of the age of the newest pose on the controller's side (age of
  /// information; before the first pose, the time since t = 0).
  double aoi_mean_s(Instant now) const;

 private:
  /// Names mostly stay from one report to the next.
  struct KnownCounters {
    std::string node;
    std::vector<std::string> names;
    std::vector<std::int64_t*> values;  ///< in counters_; null for those beyond the most
  };
  KnownCounters look_up(const counters_t& report);
  bool accept(StreamGuard& guard, std::int64_t utime, std::int64_t seq);
  void on_truth(const ground_truth_t& truth);
  void on_pose(Instant stamp);
  double age_integral_s2(Instant until) const;

  EventLoop& loop_;
  ground_truth_t truth_{};
  link_report_t uplink_{};
  link_report_t downlink_{};
  std::map<std::string, std::int64_t> counters_;
  std::map<std::string, KnownCounters> known_;  ///< by channel
  std::optional<DrivetrainObserver> drivetrain_;
  std::optional<autonomy_state_t> autonomy_;
  std::vector<TrajectoryRow> trajectory_;
  StreamGuard truth_guard_;
  StreamGuard uplink_guard_;
  StreamGuard downlink_guard_;
  StreamGuard autonomy_guard_;
  std::int64_t undecodable_ = 0;
  std::int64_t rejected_ = 0;
  std::int64_t poses_received_ = 0;
  std::int64_t commands_received_ = 0;

  double age_integral_s2_ = 0.0;  // up to last_pose_arrival_
  Instant last_pose_arrival_ = kStart;
  Instant newest_pose_stamp_ = kStart;
};

}  // namespace tether
