#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "can_bridge/cia402/config.hpp"
#include "can_bridge/drivetrain/drive_profile.hpp"
#include "can_bridge/emulated/node.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "tests/support/source_dir.hpp"

// The profile that ships, against the emulated drives of each drivetrain file that ships.

namespace tether {
namespace {

/// Profile and drives on one ideal bus; wheels follow their targets. 20 ms control cycle.
class BringUp : public ::testing::TestWithParam<const char*> {
 protected:
  BringUp()
      : config_(std::get<Cia402Config>(load_drivetrain(in_source("/drivetrains/") + GetParam()))),
        profile_(make_drive_profile(config_, VehicleConfig{})),
        drives_(config_, kStart) {
    drives_.set_wheels({});
    profile_->start(now_);
  }

  void run(int milliseconds) {
    for (int i = 0; i < milliseconds; ++i) {
      now_ += std::chrono::milliseconds{1};
      turn_wheels();
      std::vector<CanFrame> to_bridge;
      drives_.tick(now_, to_bridge);
      if (bridge_lives_ && now_.time_since_epoch() % std::chrono::milliseconds{20} == Duration{0}) {
        std::vector<CanFrame> to_drives;
        profile_->tick(now_, to_drives);
        for (const CanFrame& frame : to_drives) {
          note_reset(frame);
          drives_.on_frame(frame, now_, to_bridge);
        }
      }
      for (const CanFrame& frame : to_bridge) profile_->on_frame(frame, now_);
    }
  }
  void note_reset(const CanFrame& frame) {
    if (frame.id != canopen::kNmt ||
        frame.data[0] < static_cast<std::uint8_t>(canopen::NmtCommand::reset_node))
      return;
    for (std::size_t i = 0; i < 2; ++i) {
      const bool is_meant = frame.data[1] == 0 || frame.data[1] == config_.axes[i].node;
      if (is_meant && wheels_.speed_radps[i] != 0.0) ++resets_while_turning_;
    }
  }
  void turn_wheels() {
    const auto targets = drives_.wheel_targets_radps();
    for (std::size_t i = 0; i < 2; ++i) {
      wheels_.speed_radps[i] = targets[i];
      wheels_.angle_rad[i] += targets[i] * 1e-3;
    }
    drives_.set_wheels(wheels_);
  }
  DrivePhase phase() const { return profile_->snapshot(now_).phase; }
  std::string reason() const { return profile_->snapshot(now_).reason; }
  void enable() {
    for (int i = 0; i < 200 && phase() == DrivePhase::starting; ++i) run(20);
    ASSERT_EQ(phase(), DrivePhase::standby) << reason();
    profile_->enable();
    for (int i = 0; i < 100 && phase() != DrivePhase::enabled; ++i) run(20);
    ASSERT_EQ(phase(), DrivePhase::enabled) << reason();
  }

  Instant now_ = kStart;
  Cia402Config config_;
  std::unique_ptr<DriveProfile> profile_;
  EmulatedCia402 drives_;
  WheelStates wheels_;
  bool bridge_lives_ = true;
  int resets_while_turning_ = 0;
};

TEST_P(BringUp, EndsInEnabledWithoutMovingAWheel) {
  enable();
  EXPECT_EQ(wheels_.angle_rad[0], 0.0);
  EXPECT_EQ(wheels_.angle_rad[1], 0.0);
}

/// A drive in pre-operational has no deadline of setpoints, and the bridge's heartbeat keeps its
/// watchdog content: the bridge alone can stop it. Another sender switches it on at any time of a
/// restart.
TEST_P(BringUp, StopsADriveThatAnotherSenderSwitchesOnMeanwhile) {
  enable();
  const AxisConfig& axis = config_.axes[0];
  const auto from_another = [&](const CanFrame& frame) {
    std::vector<CanFrame> answers;
    drives_.on_frame(frame, now_, answers);
    profile_->on_frame(frame, now_);
    run(5);
  };
  int turned = 0;
  for (int offset_ms = 0; offset_ms < 300; offset_ms += 5) {
    from_another(canopen::nmt_frame(canopen::NmtCommand::pre_operational, 0));
    run(700);
    ASSERT_EQ(wheels_.speed_radps[0], 0.0) << offset_ms;
    profile_->reset_fault();
    run(offset_ms);
    from_another(canopen::sdo_download(axis.node, axis.target_velocity, 1000));
    for (int i = 0; i < 12; ++i) {
      constexpr std::array kWords{canopen::kControlShutdown, canopen::kControlSwitchOn,
                                  canopen::kControlEnableOperation};
      from_another(canopen::sdo_download(axis.node, axis.controlword, kWords.at(i % 3)));
    }
    turned += wheels_.speed_radps[0] != 0.0 ? 1 : 0;
    run(500);
    EXPECT_EQ(wheels_.speed_radps[0], 0.0) << offset_ms << ": " << reason();
    run(3000);
    EXPECT_EQ(std::exchange(resets_while_turning_, 0), 0) << offset_ms;
  }
  EXPECT_GT(turned, 0);
}

TEST_P(BringUp, TurnsBothWheelsForwardAsCommandedAndSeesThem) {
  enable();
  profile_->set_command({.v_mps = 0.5, .omega_radps = 0.3});
  run(3000);
  const VehicleConfig vehicle;
  const double left_radps = (0.5 - 0.3 * vehicle.track_m / 2.0) / vehicle.wheel_radius_m;
  const double right_radps = (0.5 + 0.3 * vehicle.track_m / 2.0) / vehicle.wheel_radius_m;
  // Targets in whole rpm, on one of the drives
  EXPECT_NEAR(wheels_.speed_radps[0], left_radps, 0.06);
  EXPECT_NEAR(wheels_.speed_radps[1], right_radps, 0.06);
  const DrivetrainSnapshot seen = profile_->snapshot(now_);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_NEAR(seen.wheels[i].speed_radps, wheels_.speed_radps[i], 0.011);
    EXPECT_NEAR(seen.wheels[i].angle_rad, wheels_.angle_rad[i], 0.1);
  }
}

TEST_P(BringUp, WithoutItsBridgeTheVehicleStopsByItself) {
  enable();
  profile_->set_command({.v_mps = 0.5, .omega_radps = 0.0});
  run(3000);
  ASSERT_GT(wheels_.speed_radps[0], 1.0);
  bridge_lives_ = false;
  run(250 + 400);
  EXPECT_EQ(wheels_.speed_radps[0], 0.0);
  EXPECT_EQ(wheels_.speed_radps[1], 0.0);
  bridge_lives_ = true;
  run(2000);
  EXPECT_NE(phase(), DrivePhase::enabled) << reason();
  EXPECT_EQ(wheels_.speed_radps[0], 0.0) << "no motion because the bridge is back";
  EXPECT_EQ(wheels_.speed_radps[1], 0.0);
}

TEST_P(BringUp, AFaultOfOneDriveStopsBothWheels) {
  enable();
  profile_->set_command({.v_mps = 0.5, .omega_radps = 0.0});
  run(3000);
  drives_.inject({config_.axes[1].node, DriveFault::Kind::fault, 0x2310}, now_);
  run(1000);
  EXPECT_EQ(phase(), DrivePhase::faulted);
  EXPECT_EQ(wheels_.speed_radps[0], 0.0);
  EXPECT_EQ(wheels_.speed_radps[1], 0.0);
}

TEST_P(BringUp, IsRefusedByADriveThatAbortsItsWatchdog) {
  drives_.inject(
      {0, DriveFault::Kind::sdo_abort, static_cast<double>(config_.watchdogs[0].object.index)},
      now_);
  run(5000);
  EXPECT_EQ(phase(), DrivePhase::refused) << reason();
}

INSTANTIATE_TEST_SUITE_P(ShippedDrivetrains, BringUp,
                         ::testing::Values("two_node_cia402.toml", "dual_axis_cia402.toml",
                                           "zlac8015d.toml"),
                         [](const auto& info) {
                           const std::string name = info.param;
                           return name.substr(0, name.find('.'));
                         });

}  // namespace
}  // namespace tether
