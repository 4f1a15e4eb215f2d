#pragma once

#include <cstdint>
#include <string>
#include <tether/drivetrain_state_t.hpp>
#include <tether/ground_truth_t.hpp>
#include <tether/odometry_t.hpp>

#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/stream_guard.hpp"
#include "common/scenario/scenario.hpp"

namespace tether {

/// Watches the CAN drivetrain of a run on the bus: was it armed, how often was it stopped and why,
/// and how well does the wheels' odometry agree with the truth. What comes after run.duration_s,
/// when live drives are brought to a stop, does not count.
class DrivetrainObserver {
 public:
  DrivetrainObserver(const Scenario& scenario, EventLoop& loop, Bus& bus);
  DrivetrainObserver(const DrivetrainObserver&) = delete;
  DrivetrainObserver& operator=(const DrivetrainObserver&) = delete;

  /// Newest reports; all zero before the first.
  const drivetrain_state_t& state() const { return state_; }
  const odometry_t& odometry() const { return odometry_; }

  bool ever_armed() const { return ever_armed_; }
  /// Time spent ARMED since t = 0.
  double armed_s() const { return armed_s_; }
  /// Why the vehicle last left ARMED, and when; empty if it never did.
  const std::string& stop_reason() const { return stop_reason_; }
  double stopped_at_s() const { return stopped_at_s_; }

  /// Path length of the axle's midpoint since t = 0, by the truth and by the wheels.
  double true_distance_m() const { return true_distance_m_; }
  double odometry_distance_m() const { return odometry_.distance_m; }
  /// Distance between the vehicle's true position and where odometry puts it, now.
  double odometry_error_m() const;

 private:
  void on_state(const drivetrain_state_t& m);
  void on_truth(const ground_truth_t& m);

  EventLoop& loop_;
  std::int64_t end_utime_;
  StreamGuard state_guard_;
  StreamGuard odometry_guard_;
  StreamGuard truth_guard_;
  drivetrain_state_t state_{};
  odometry_t odometry_{};
  bool any_truth_ = false;
  double true_x_m_ = 0.0;
  double true_y_m_ = 0.0;
  bool ever_armed_ = false;
  double armed_s_ = 0.0;
  std::string stop_reason_;
  double stopped_at_s_ = 0.0;
  double true_distance_m_ = 0.0;
  std::int64_t undecodable_ = 0;
};

}  // namespace tether
