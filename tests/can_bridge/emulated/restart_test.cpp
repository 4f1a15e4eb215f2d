#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "can_bridge/canopen/canopen.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/drivetrain/drive_profile.hpp"
#include "can_bridge/emulated/cia402.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "common/vehicle/vehicle_config.hpp"

// A bridge that is killed at speed and started again at once, and what its drives do meanwhile.

namespace tether {
namespace {

constexpr std::int64_t kPowerOff = 2, kQuickStop = 3;

/// The shipped file, without setpoint deadlines: only the heartbeat tells that the bridge is lost.
Cia402Config two_nodes(bool brake, std::int64_t reaction) {
  auto config = std::get<Cia402Config>(
      load_drivetrain(TETHER_SOURCE_DIR "/drivetrains/two_node_cia402.toml"));
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
  explicit Vehicle(const Cia402Config& config) : config_(config), drives_(config, kStart) {
    drives_.set_wheels({});
    start_bridge();
  }

  void start_bridge() {
    bridge_ = make_drive_profile(config_, VehicleConfig{});
    bridge_->start(now_);
  }
  void kill_bridge() { bridge_.reset(); }
  void reset_fault() { bridge_->reset_fault(); }

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
    ASSERT_TRUE(reaches(DrivePhase::enabled, 1000)) << reason();
    bridge_->set_command({.v_mps = v_mps, .omega_radps = 0.0});
    run(3000);
    ASSERT_NEAR(speed_mps(), v_mps, 0.01);
    fastest_reset_mps_ = 0.0;
    resets_ = 0;
  }

  DrivePhase phase() const { return bridge_->snapshot(now_).phase; }
  std::string reason() const { return bridge_->snapshot(now_).reason; }
  double speed_mps() const {
    return std::max(std::abs(wheels_.speed_radps[0]), std::abs(wheels_.speed_radps[1])) *
           VehicleConfig{}.wheel_radius_m;
  }
  int resets() const { return resets_; }
  double fastest_reset_mps() const { return fastest_reset_mps_; }

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
};

void expect_no_reset_at_speed(Vehicle& vehicle) {
  EXPECT_TRUE(vehicle.reaches(DrivePhase::standby, 12'000)) << vehicle.reason();
  EXPECT_EQ(vehicle.resets(), 2);
  EXPECT_LT(vehicle.fastest_reset_mps(), 0.03);
  EXPECT_EQ(vehicle.speed_mps(), 0.0);
}

TEST(Restart, DrivesThatQuickStopAreResetWhenTheyStand) {
  Vehicle vehicle(two_nodes(true, kQuickStop));
  vehicle.drive(3.0);
  vehicle.kill_bridge();
  vehicle.run(400);
  ASSERT_GT(vehicle.speed_mps(), 1.0);
  vehicle.start_bridge();
  expect_no_reset_at_speed(vehicle);
}

TEST(Restart, WheelsThatCoastAreLeftAloneUntilTheyStand) {
  Vehicle vehicle(two_nodes(false, kPowerOff));
  vehicle.drive(1.0);
  vehicle.kill_bridge();
  vehicle.run(400);
  ASSERT_GT(vehicle.speed_mps(), 0.8);
  vehicle.start_bridge();
  expect_no_reset_at_speed(vehicle);
}

TEST(Restart, WheelsThatCoastForLongAreRefusedAndNotReset) {
  Vehicle vehicle(two_nodes(false, kPowerOff));
  vehicle.drive(3.0);
  vehicle.kill_bridge();
  vehicle.run(400);
  vehicle.start_bridge();
  ASSERT_TRUE(vehicle.reaches(DrivePhase::refused, 6000)) << vehicle.reason();
  EXPECT_NE(vehicle.reason().find("still turns at"), std::string::npos) << vehicle.reason();
  EXPECT_EQ(vehicle.resets(), 0);
  EXPECT_GT(vehicle.speed_mps(), 0.3);
  vehicle.run(3000);
  vehicle.reset_fault();
  expect_no_reset_at_speed(vehicle);
}

}  // namespace
}  // namespace tether
