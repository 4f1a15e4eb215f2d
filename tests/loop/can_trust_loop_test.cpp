#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <tether/ground_truth_t.hpp>
#include <tether/odometry_t.hpp>
#include <vector>

#include "tests/support/source_dir.hpp"
#include "tests/support/virtual_world.hpp"
#include "tools/nodes/can_loop.hpp"
#include "tools/nodes/closed_loop.hpp"

// Trust of the bridge in CAN frames, in the whole loop: counters after a gap in the
// feedback, and feedback of two sources.

namespace tether {
namespace {

using test::at_s;
using ::testing::HasSubstr;

/// A run with a possible intruder on the bus.
struct Meddled {
  explicit Meddled(std::vector<std::string> overrides = {})
      : loop(load_scenario(in_source("/scenarios/hil_vcan.toml"), [&] {
          overrides.emplace_back("run.duration_s=20");
          return overrides;
        }())) {
    keep("CAN/STATE", state);
    keep("CAN/ODOMETRY", odometry);
    keep("SIM/TRUTH", truth);
  }
  template <class LcmType>
  void keep(const std::string& channel, LcmType& newest) {
    subscribe<LcmType>(loop.bus(), channel, kDeepQueue, undecodable,
                       [&newest](const LcmType& m) { newest = m; });
  }
  void at(double s, const std::function<void()>& task) {
    loop.loop().at(at_s(s), Priority::node, [task](Instant) { task(); });
  }
  void run_to(double s) { loop.run_until(at_s(s)); }
  void reset_at(double s) {
    at(s, [this, s] {
      drive_request_t m{};
      m.utime = to_utime(at_s(s));
      m.seq = 100;
      m.request = drive_request_t::RESET;
      publish(loop.bus(), "CAN/REQUEST", m);
    });
  }
  InProcessCan::Port& plug() { return loop.can()->bridge_port(); }
  double error_m() const { return std::hypot(odometry.x_m - truth.x_m, odometry.y_m - truth.y_m); }
  double sigma_m() const { return std::sqrt(odometry.cov_x_x_m2 + odometry.cov_y_y_m2); }

  ClosedLoop loop;
  drivetrain_state_t state{};
  odometry_t odometry{};
  ground_truth_t truth{};
  std::int64_t undecodable = 0;
};

TEST(CanTrust, OdometryTakesUpWhatDrivesCountedWhileTheBridgeWasUnplugged) {
  Meddled run;
  run.at(10.0, [&] { run.plug().set_state(CanState::down); });
  run.at(12.0, [&] { run.plug().set_state(CanState::up); });
  run.run_to(9.98);
  ASSERT_GT(run.truth.v_mps, 1.9);
  const double driven_m = run.odometry.distance_m, sigma_m = run.sigma_m();
  run.reset_at(13.0);
  run.run_to(20.0);
  EXPECT_EQ(run.state.state, drivetrain_state_t::DISARMED) << run.state.reason;
  EXPECT_GT(run.odometry.distance_m, driven_m + 0.7) << "0.25 s, and braking at 4 m/s²";
  EXPECT_LT(run.error_m(), 0.1);
  EXPECT_GT(run.sigma_m(), sigma_m);
  EXPECT_LT(run.error_m(), 3.0 * run.sigma_m());
}

TEST(CanTrust, OfADriveThatRebootsAtSpeedTheWayIsUnknownAndThePoseSaysSo) {
  Meddled run({"can.inject=reboot", "can.inject_node=2", "can.inject_at_s=10"});
  run.run_to(10.0);
  const double sigma_m = run.sigma_m();
  run.reset_at(13.0);
  run.run_to(20.0);
  EXPECT_EQ(run.state.state, drivetrain_state_t::DISARMED) << run.state.reason;
  EXPECT_GT(run.sigma_m(), sigma_m + 1.0);
  EXPECT_LT(run.error_m(), 3.0 * run.sigma_m());
}

TEST(CanTrust, ASecondSourceOfFeedbackStopsTheVehicleWithinThreeSyncPeriods) {
  Meddled run;
  InProcessCan::Port& forger = run.loop.can()->can().add_port();
  bool forges = false;
  forger.on_frame({CanFilter{0x080}}, [&](const CanFrame&) {
    // Right drive: OperationEnabled, at rest.
    if (forges) forger.send(CanFrame::make(0x182, {0x37, 0x02, 0, 0, 0, 0}));
  });
  run.at(10.0, [&] { forges = true; });
  run.run_to(10.0);
  ASSERT_EQ(run.state.state, drivetrain_state_t::ARMED);
  run.run_to(10.08);
  EXPECT_THAT(run.state.reason, HasSubstr("two sources send 0x182"));
  run.run_to(11.5);
  EXPECT_LT(std::hypot(run.truth.left_rim_mps, run.truth.right_rim_mps), 0.02);
  EXPECT_EQ(run.state.state, drivetrain_state_t::FAULT);
}

TEST(CanTrust, FramesThatWaitOnABusyBusAreNoSecondSource) {
  Meddled run;
  InProcessCan::Port& chatter = run.loop.can()->can().add_port();
  // 15 ms of the 20 ms of a cycle the bus is taken by frames that go first.
  for (int i = 0; i < 500; ++i) {
    run.at(9.0 + 0.02 * i, [&] {
      for (int k = 0; k < 10; ++k) {
        chatter.send(CanFrame::make(0x100, {1, 2, 3, 4, 5, 6, 7, 8}));
      }
    });
  }
  run.run_to(19.0);
  EXPECT_EQ(run.state.state, drivetrain_state_t::ARMED) << run.state.reason;
}

}  // namespace
}  // namespace tether
