#include "tools/nodes/can_loop.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <string>
#include <tether/drivetrain_state_t.hpp>
#include <tether/ground_truth_t.hpp>
#include <tether/twist_t.hpp>
#include <vector>

#include "sim/node/sim_node.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/support/virtual_world.hpp"
#include "tests/tools/runs/run_files.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/runs/run_observer.hpp"

// The whole loop through the CAN drivetrain in virtual time: the shipping controller, relay, bridge
// and emulated drives, simulated wheels and their encoders.

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::contents;
using test::Folder;
using test::run_and_hash;
using test::run_into;
using test::Seen;

Scenario hil(const std::vector<std::string>& overrides = {}) {
  return load_scenario(in_source("/scenarios/hil_vcan.toml"), overrides);
}

/// A run with everything that the safety logic did in it.
struct Drive {
  explicit Drive(const Scenario& scenario)
      : loop(scenario), observer(scenario, loop.loop(), loop.bus()) {
    collect("CAN/STATE", states);
    collect("SIM/TRUTH", truths);
    collect("AGV/CMD_VEL", commands);
    loop.run();
  }

  template <class LcmType>
  void collect(const std::string& channel, std::vector<Seen<LcmType>>& out) {
    subscribe<LcmType>(loop.bus(), channel, kDeepQueue, undecodable,
                       [this, &out](const LcmType& m) {
                         out.push_back({loop.loop().now(), m});
                       });
  }

  /// When the vehicle left ARMED; the run's end if it did not.
  Instant stopped_at() const {
    bool armed = false;
    for (const auto& [when, m] : states) {
      const bool now_armed = m.state == drivetrain_state_t::ARMED;
      if (armed && !now_armed) return when;
      armed = now_armed;
    }
    return loop_end;
  }

  /// From when on both wheels stand for the rest of the run.
  Instant standstill_at() const {
    Instant since = kStart;
    for (const auto& [when, m] : truths) {
      if (std::hypot(m.left_rim_mps, m.right_rim_mps) > 0.02) since = when;
    }
    return since;
  }

  ClosedLoop loop;
  RunObserver observer;
  std::int64_t undecodable = 0;
  Instant loop_end = Instant::max();
  std::vector<Seen<drivetrain_state_t>> states;
  std::vector<Seen<ground_truth_t>> truths;
  std::vector<Seen<twist_t>> commands;
};

TEST(CanLoop, TheErrorIsWithin3PercentOfTheDirectRun) {
  const Drive direct(hil({"vehicle.drivetrain=direct"}));
  const Drive can(hil());
  ASSERT_GT(direct.observer.truth().epsilon_m, 1.0);
  EXPECT_NEAR(can.observer.truth().epsilon_m / direct.observer.truth().epsilon_m, 1.0, 0.03);
  EXPECT_EQ(can.observer.drivetrain()->state().disarms, 0);
  EXPECT_NEAR(can.observer.drivetrain()->armed_s(), 62.0, 0.05);
}

TEST(CanLoop, OdometryFromCanIsWithin1PercentOfTheTrueDistance) {
  const Drive run(hil());
  const auto& d = *run.observer.drivetrain();
  ASSERT_GT(d.true_distance_m(), 100.0);
  EXPECT_NEAR(d.odometry_distance_m() / d.true_distance_m(), 1.0, 0.01);
  EXPECT_LT(d.odometry_error_m(), 0.01 * d.true_distance_m());
}

TEST(CanLoop, SameScenarioAndSeedGiveByteIdenticalFiles) {
  const std::vector<std::string> noisy{
      "run.duration_s=15", "channel.prr=0.8",   "sensor.position_noise_m=0.02",
      "can.inject=reboot", "can.inject_at_s=8", "can.inject_node=2"};
  const auto first = run_and_hash(hil(noisy));
  EXPECT_GT(first.log_size, 1'000'000U);
  EXPECT_EQ(run_and_hash(hil(noisy)), first);
  auto other_seed = noisy;
  other_seed.emplace_back("run.seed=2");
  EXPECT_FALSE(run_and_hash(hil(other_seed)) == first);
}

TEST(CanLoop, TheOutputFolderHoldsTheDrivetrainAndReproducesTheRun) {
  const Folder folder;
  run_into(folder.path / "a", hil({"run.duration_s=3"}));
  run_into(folder.path / "b", load_scenario((folder.path / "a" / "scenario.toml").string(), {}));
  EXPECT_EQ(contents(folder.path / "a" / "run.lcmlog"), contents(folder.path / "b" / "run.lcmlog"));
  EXPECT_EQ(contents(folder.path / "a" / "drivetrain.toml"),
            contents(in_source("/drivetrains/two_node_cia402.toml")));
}

class EachDrivetrain : public ::testing::TestWithParam<const char*> {};

TEST_P(EachDrivetrain, DrivesThePath) {
  const std::string file = in_source("/drivetrains/") + GetParam() + ".toml";
  const Drive run(hil({"can.drivetrain=" + file}));
  EXPECT_LT(run.observer.truth().epsilon_m, 1.85);
  EXPECT_EQ(run.observer.drivetrain()->state().disarms, 0);
}

INSTANTIATE_TEST_SUITE_P(CanLoop, EachDrivetrain,
                         ::testing::Values("two_node_cia402", "dual_axis_cia402", "zlac8015d",
                                           "agilex_v2"),
                         [](const auto& info) { return std::string(info.param); });

struct FaultCase {
  const char* kind;
  double stopped_within_ms;  ///< from the fault until the bridge has left ARMED
  double
      standstill_within_ms;  ///< from the fault until the wheels stand: 2.8 m/s at 3 m/s2 is 0.9 s
  std::int32_t ends_in = drivetrain_state_t::FAULT;
};

class EachFault : public ::testing::TestWithParam<FaultCase> {};

TEST_P(EachFault, OfOneWheelStopsBothForGood) {
  const auto& [kind, stopped_within_ms, standstill_within_ms, ends_in] = GetParam();
  const Drive run(hil({std::string("can.inject=") + kind, "can.inject_node=2", "can.inject_at_s=10",
                       "run.duration_s=20"}));
  EXPECT_GE(run.stopped_at(), at_s(10));
  EXPECT_LE(run.stopped_at(), at_s(10) + from_seconds(stopped_within_ms * 1e-3));
  EXPECT_LE(run.standstill_at(), at_s(10) + from_seconds(standstill_within_ms * 1e-3));
  EXPECT_EQ(run.observer.drivetrain()->state().state, ends_in);
  EXPECT_EQ(run.observer.drivetrain()->state().disarms, 1);
}

// A drive that has fallen silent gives no witness of its standstill.
INSTANTIATE_TEST_SUITE_P(
    CanLoop, EachFault,
    ::testing::Values(FaultCase{"fault", 40, 1500}, FaultCase{"reboot", 120, 1500},
                      FaultCase{"silence", 120, 1500, drivetrain_state_t::UNCONFIRMED},
                      FaultCase{"encoder_freeze", 500, 2000}),
    [](const auto& info) { return std::string(info.param.kind); });

/// A network that is gone for a second every few seconds.
std::vector<std::string> outages(int seed) {
  return {"run.seed=" + std::to_string(seed),
          "run.duration_s=20",
          "channel.model=markov",
          "channel.markov.good.prr=0.9",
          "channel.markov.bad.prr=0.0",
          "channel.markov.mean_good_s=6",
          "channel.markov.mean_bad_s=0.6"};
}

class EachSeed : public ::testing::TestWithParam<int> {};

TEST_P(EachSeed, NothingDrivesOnOldCommandsAndNothingStartsAgainByItself) {
  const Drive run(hil(outages(GetParam())));
  auto command = run.commands.begin();
  Instant newest_stamp = at_s(-100);
  bool was_armed = false;
  bool disarmed_since = false;
  for (const auto& [when, m] : run.states) {
    for (; command != run.commands.end() && command->when <= when; ++command) {
      newest_stamp = std::max(newest_stamp, from_utime(command->message.utime));
    }
    const Duration age = when - newest_stamp;
    const bool armed = m.state == drivetrain_state_t::ARMED;
    if (armed) {
      EXPECT_LT(age, std::chrono::milliseconds{520}) << "at " << to_seconds(when);
    }
    if (armed) {
      EXPECT_FALSE(disarmed_since) << "armed again at " << to_seconds(when);
    }
    const bool may_move = armed || m.state == drivetrain_state_t::STOPPING;
    if (!may_move) {
      EXPECT_EQ(std::hypot(m.v_mps, m.omega_radps), 0.0) << to_seconds(when);
    }
    disarmed_since = disarmed_since || (was_armed && !armed);
    was_armed = armed;
  }
  if (disarmed_since) {
    EXPECT_LE(run.standstill_at(), run.stopped_at() + std::chrono::milliseconds{2000});
  }
}

INSTANTIATE_TEST_SUITE_P(CanLoop, EachSeed, ::testing::Range(1, 11));

TEST(CanLoop, SomeOfTheseSeedsDoStopTheVehicleAndSomeDoNot) {
  int stopped = 0;
  for (int seed = 1; seed <= 10; ++seed) {
    stopped += Drive(hil(outages(seed))).observer.drivetrain()->state().disarms > 0 ? 1 : 0;
  }
  EXPECT_GT(stopped, 1);
  EXPECT_LT(stopped, 10);
}

TEST(CanLoop, AfterTheRunsEndTheWorldGoesOnUntilTheDrivesHaveStoppedAndNothingOfItCounts) {
  const Scenario scenario = hil({"run.duration_s=5"});
  ClosedLoop loop(scenario);
  RunObserver observer(scenario, loop.loop(), loop.bus());
  loop.run_until(at_s(5));
  const Metrics at_end = loop.sim().metrics();
  ASSERT_GT(loop.sim().vehicle().state().twist.v_mps, 1.0);
  loop.run_until(at_s(9));
  EXPECT_NEAR(loop.sim().vehicle().state().twist.v_mps, 0.0, 0.02);
  EXPECT_EQ(loop.sim().metrics().epsilon_m(), at_end.epsilon_m());
  EXPECT_EQ(observer.truth().utime, 5'000'000);
  EXPECT_EQ(observer.drivetrain()->state().utime, 5'000'000);
  EXPECT_EQ(observer.drivetrain()->stop_reason(), "");
}

TEST(CanLoop, DrivesTurnTheKinematicPlantsWheelsAsTheyTurnOdes) {
  const Drive ode(hil({"run.duration_s=20"}));
  const Drive kinematic(hil({"run.duration_s=20", "vehicle.plant=kinematic"}));
  EXPECT_EQ(kinematic.observer.drivetrain()->state().disarms, 0);
  EXPECT_GT(kinematic.observer.drivetrain()->true_distance_m(), 20.0);
  // Nothing slips; a report is a cycle of 20 ms old, in which 3 m/s go 0.06 m.
  EXPECT_LT(kinematic.observer.drivetrain()->odometry_error_m(), 0.08);
  EXPECT_NEAR(kinematic.observer.truth().x_m, ode.observer.truth().x_m, 0.05);
  EXPECT_NEAR(kinematic.observer.truth().y_m, ode.observer.truth().y_m, 0.05);
}

TEST(CanLoop, WithoutALeadTheVehicleIsNeverArmedBecauseTheControllerAlreadyDrives) {
  const Drive run(hil({"run.lead_s=0", "run.duration_s=5"}));
  EXPECT_FALSE(run.observer.drivetrain()->ever_armed());
  EXPECT_NE(run.observer.drivetrain()->state().reason.find("not zero"), std::string::npos)
      << run.observer.drivetrain()->state().reason;
  EXPECT_NEAR(run.observer.truth().v_mps, 0.0, 1e-6);
}

}  // namespace
}  // namespace tether
