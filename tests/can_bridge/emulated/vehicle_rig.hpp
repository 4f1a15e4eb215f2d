#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/drivetrain/drive_profile.hpp"
#include "can_bridge/emulated/node.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "tests/support/source_dir.hpp"

namespace tether::test {

inline constexpr std::int64_t kPowerOff = 2, kQuickStop = 3;

/// The shipped file, without setpoint deadlines: only the heartbeat tells that the bridge is lost.
inline Cia402Config without_deadlines(bool brake, std::int64_t reaction) {
  auto config =
      std::get<Cia402Config>(load_drivetrain(in_source("/drivetrains/two_node_cia402.toml")));
  config.emulated_brake = brake;
  for (WatchdogConfig& watchdog : config.watchdogs) watchdog.reaction_value = reaction;
  for (PdoConfig& pdo : config.pdos) {
    if (!pdo.transmit) pdo.event_timer_ms = 0;
  }
  return config;
}

/// Bridge and drives on one ideal bus; wheels follow their targets. 20 ms control cycle.
class Vehicle {
 public:
  static constexpr double kRequired_mps2 = 3.0;

  explicit Vehicle(const Cia402Config& config) : config_(config), drives_(config, kStart) {
    drives_.set_wheels({});
    start_bridge();
  }

  void start_bridge() {
    bridge_ = make_drive_profile(config_, VehicleConfig{});
    bridge_->require_deceleration(kRequired_mps2);
    bridge_->start(now_);
  }
  void kill_bridge() { bridge_.reset(); }
  void reset_fault() { bridge_->reset_fault(); }
  DriveProfile& bridge() { return *bridge_; }
  EmulatedCia402& drives() { return drives_; }
  Instant now() const { return now_; }

  /// Another's frame, now: to the drives, and to the bridge if it can hear it.
  void send(const CanFrame& frame, bool to_bridge = true) {
    std::vector<CanFrame> replies;
    drives_.on_frame(frame, now_, replies);
    if (to_bridge) bridge_->on_frame(frame, now_);
    for (const CanFrame& reply : replies) bridge_->on_frame(reply, now_);
  }

  void run(int milliseconds) {
    for (int i = 0; i < milliseconds; ++i) {
      now_ += std::chrono::milliseconds{1};
      turn_wheels();
      std::vector<CanFrame> to_bridge;
      drives_.tick(now_, to_bridge);
      if (!bridge_) continue;
      if (now_.time_since_epoch() % std::chrono::milliseconds{20} == Duration{0}) {
        cycle(to_bridge);
      }
      for (const CanFrame& frame : to_bridge) bridge_->on_frame(frame, now_);
    }
  }
  bool reaches(DrivePhase phase, int milliseconds) {
    for (int t = 0; t < milliseconds && this->phase() != phase; t += 20) run(20);
    return this->phase() == phase;
  }
  void drive(double v_mps) {
    ASSERT_TRUE(reaches(DrivePhase::standby, 5000)) << reason();
    bridge_->enable();
    ASSERT_TRUE(reaches(DrivePhase::enabled, 3000)) << reason();
    bridge_->set_command({.v_mps = v_mps, .omega_radps = 0.0});
    run(3000);
    ASSERT_NEAR(speed_mps(), v_mps, 0.01);
    fastest_reset_mps_ = fastest_cut_mps_ = 0.0;
    resets_ = 0;
  }

  DrivePhase phase() const { return bridge_->snapshot(now_).phase; }
  std::string reason() const { return bridge_->snapshot(now_).reason; }
  /// Speed of the faster wheel.
  double speed_mps() const { return std::max(std::abs(rim_mps(0)), std::abs(rim_mps(1))); }
  double rim_mps(std::size_t i) const {
    return wheels_.speed_radps.at(i) * VehicleConfig{}.wheel_radius_m;
  }
  /// How far it turned to the left since the beginning.
  double yaw_rad() const {
    return (wheels_.angle_rad[1] - wheels_.angle_rad[0]) * VehicleConfig{}.wheel_radius_m /
           VehicleConfig{}.track_m;
  }
  /// The time until both wheels stand, at most 10 s.
  int time_to_standstill_ms() {
    int t = 0;
    for (; t < 10'000 && speed_mps() > 0.02; ++t) run(1);
    return t;
  }
  int resets() const { return resets_; }
  double fastest_reset_mps() const { return fastest_reset_mps_; }
  /// The fastest wheel whose power the bridge cut by "disable voltage".
  double fastest_cut_mps() const { return fastest_cut_mps_; }
  /// How far both wheels went on the mean.
  double way_m() const {
    return (wheels_.angle_rad[0] + wheels_.angle_rad[1]) / 2.0 * VehicleConfig{}.wheel_radius_m;
  }
  /// How many heartbeats the bridge sends within this time.
  int heartbeats(int milliseconds) {
    heartbeats_ = setpoints_ = 0;
    run(milliseconds);
    return heartbeats_;
  }
  /// How many setpoints it sent meanwhile.
  int setpoints() const { return setpoints_; }

 private:
  void turn_wheels() {
    const auto targets = drives_.wheel_targets_radps();
    for (std::size_t i = 0; i < 2; ++i) {
      wheels_.speed_radps[i] = targets[i];
      wheels_.angle_rad[i] += targets[i] * 1e-3;
    }
    drives_.set_wheels(wheels_);
  }
  void cycle(std::vector<CanFrame>& to_bridge) {
    std::vector<CanFrame> to_drives;
    bridge_->tick(now_, to_drives);
    for (const CanFrame& frame : to_drives) {
      if (frame.id == canopen::kNmt && frame.data[0] == 0x81) {
        ++resets_;
        fastest_reset_mps_ = std::max(fastest_reset_mps_, speed_mps());
      }
      if (frame.id == 0x77F) ++heartbeats_;
      if (frame.id == 0x201 || frame.id == 0x202) ++setpoints_;
      const std::size_t wheel = frame.id == 0x202 ? 1 : 0;
      const bool disables = (frame.id == 0x201 || frame.id == 0x202) && (frame.data[0] & 2) == 0;
      if (disables && drives_.nodes()[wheel % drives_.nodes().size()]->powers(wheel)) {
        fastest_cut_mps_ = std::max(fastest_cut_mps_, std::abs(rim_mps(wheel)));
      }
      drives_.on_frame(frame, now_, to_bridge);
    }
  }

  Instant now_ = kStart;
  Cia402Config config_;
  EmulatedCia402 drives_;
  std::unique_ptr<DriveProfile> bridge_;
  WheelStates wheels_;
  int resets_ = 0;
  double fastest_reset_mps_ = 0.0;
  double fastest_cut_mps_ = 0.0;
  int heartbeats_ = 0;
  int setpoints_ = 0;
};

}  // namespace tether::test
