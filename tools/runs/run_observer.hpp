#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <tether/autonomy_state_t.hpp>
#include <tether/counters_t.hpp>
#include <tether/ground_truth_t.hpp>
#include <tether/link_report_t.hpp>
#include <vector>

#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/stream_guard.hpp"
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

/// Watches all vehicles of a run.
class FleetObserver {
 public:
  /// `members`: of fleet_members().
  FleetObserver(const std::vector<Scenario>& members, EventLoop& loop, Bus& bus);

  const std::vector<const RunObserver*>& vehicles() const { return vehicles_; }
  const std::vector<std::string>& names() const { return names_; }
  const RunObserver& first() const { return *vehicles_.front(); }
  bool is_one() const { return vehicles_.size() == 1; }

  /// Counters of all vehicles; what has one name, together. What a program counts as a whole, once.
  std::map<std::string, std::int64_t> counters() const;

  /// Throws if a result is not a number: then it is invalid and has no summary.
  void check_finite() const;

  /// Throws if a vehicle got what is no command to it: numbers that are not finite, malformed
  /// bytes, plans without a policy that follows them. For runs in which only their controller can
  /// have sent that. And if a vehicle refused all that it got.
  void check_commands() const;
  /// Names a vehicle that refused all commands and plans that reached it, as those of another run
  /// or from the future, and why; "" if there is none.
  std::string refused_commands() const;
  /// Names the streams whose numbers jumped further than losses explain (StreamGuard); "" if there
  /// is none.
  std::string jumps() const;
  /// Names the streams whose numbers began again (StreamGuard), as they do when a sender restarts
  /// or another one sends in its name; "" if there is none.
  std::string restarts() const;
  /// Names the vehicles for which more poses or commands came out of the network than the relay
  /// has delivered by its last report: another program sent them, whatever their source address
  /// says. "" if there is none. After the end of the run, for all that was sent has come then.
  std::string surplus() const;

 private:
  /// "AGV: sim.command.jumped 1, …" for the counters of this kind that are not 0.
  std::string streams_with(const std::string& kind) const;

  std::vector<std::unique_ptr<const RunObserver>> observers_;
  std::vector<const RunObserver*> vehicles_;
  std::vector<std::string> names_;
  std::vector<bool> poses_come_from_relay_;  ///< by vehicle
};

}  // namespace tether
