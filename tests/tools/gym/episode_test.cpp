#include "tools/gym/episode.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <tether/controller_report_t.hpp>
#include <tether/plan_t.hpp>

#include "common/node/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "sim/node/sim_node.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/runs/output_folder.hpp"

// Loops whose decisions are asked for outside are the loops of `tether run`.

namespace tether {
namespace {

using test::contents;
using test::Folder;
using Overrides = std::vector<std::string>;

Scenario scenario_with(Overrides overrides) {
  overrides.insert(overrides.begin(), {"vehicle.plant=kinematic", "run.duration_s=20",
                                       "sensor.rate_hz=10", "sensor.position_noise_m=0.02"});
  return load_scenario(in_source("/scenarios/paper.toml"), overrides);
}

const Overrides kBad{"channel.prr=0.7", "channel.delay_ms=60", "channel.jitter.law=normal",
                     "channel.jitter.sd_ms=20"};

Overrides both(Overrides a, const Overrides& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

/// A run without an episode: its log, its ε, and what its law decided when it was asked.
struct Outcome {
  std::string log;
  double epsilon_m = 0.0;
  std::vector<std::vector<double>> twists, plans;
};

Outcome run_of(const Scenario& scenario) {
  const Folder folder;
  Outcome run;
  {
    ClosedLoop loop(scenario);
    EventLogWriter log(folder.path / "log", loop.loop(), loop.bus());
    std::int64_t undecodable = 0;
    subscribe<controller_report_t>(
        loop.bus(), "CTRL/REPORT", 1, undecodable, [&run](const controller_report_t& m) {
          const bool asked = m.pose_seq >= 0 && m.pose_timed_out == 0 && m.utime >= 0;
          if (asked) run.twists.push_back({m.v_mps, m.omega_radps});
        });
    subscribe<plan_t>(loop.bus(), "CTRL/PLAN", 1, undecodable, [&run](const plan_t& m) {
      std::vector<double>& twists = run.plans.emplace_back();
      for (std::size_t i = 0; i < m.v_mps.size(); ++i) {
        twists.push_back(m.v_mps[i]);
        twists.push_back(m.omega_radps[i]);
      }
    });
    loop.run();
    run.epsilon_m = loop.sim().metrics().epsilon_m();
    log.close();
  }
  run.log = contents(folder.path / "log");
  return run;
}

/// An episode of these actions, one after another, or of the only one again and again.
Outcome episode_of(const Scenario& scenario, ActionKind kind,
                   const std::vector<std::vector<double>>& actions) {
  const Folder folder;
  Outcome run;
  Episode episode(scenario, {kind, {}}, folder.path / "log");
  double rewards = 0.0;
  for (std::size_t i = 0; !episode.is_over(); ++i) {
    episode.step(actions.size() == 1 ? actions[0] : actions.at(i));
    rewards += episode.reward();
  }
  run.epsilon_m = episode.metrics().epsilon_m();
  run.log = contents(folder.path / "log");
  EXPECT_NEAR(rewards, -run.epsilon_m * scenario.get<RunSettings>().duration_s, 1e-9);
  return run;
}

void expect_the_run_itself(const Overrides& overrides, ActionKind kind,
                           const std::vector<double>& action) {
  const Scenario scenario = scenario_with(overrides);
  const Outcome run = run_of(scenario);
  const Outcome episode = episode_of(scenario, kind, {action});
  EXPECT_GT(run.log.size(), 50'000U);
  EXPECT_TRUE(episode.log == run.log) << ::testing::PrintToString(overrides);
  EXPECT_EQ(episode.epsilon_m, run.epsilon_m);
}

TEST(Episode, OfTheShippingLawsDecisionsIsTheRunByteForByte) {
  const Overrides timer{"controller.trigger=timer", "controller.rate_hz=20"};
  const Overrides plans{"actuator.policy=horizon", "controller.horizon_s=5"};
  for (const Overrides& network : {Overrides{}, kBad}) {
    for (const Overrides& trigger :
         {Overrides{}, timer, Overrides{"controller.pose_timeout_s=0.25"},
          Overrides{"controller.send=changed"}}) {
      const Overrides common = both(network, trigger);
      expect_the_run_itself(common, ActionKind::send, {1.0});
      expect_the_run_itself(common, ActionKind::tau, {2.0, 1.0});
      expect_the_run_itself(both(common, {"controller.law=tracking_compensated"}), ActionKind::send,
                            {1.0});
      for (const char* law : {"predictive", "predictive_consistent"}) {
        expect_the_run_itself(both(both(common, plans), {std::string("controller.law=") + law}),
                              ActionKind::send, {1.0});
      }
    }
  }
}

TEST(Episode, OfTheShippingLawIsTheRunWithOdeAFilterAndALead) {
  expect_the_run_itself(both(kBad, {"vehicle.plant=ode", "controller.estimator=ekf",
                                    "sensor.odometry_rate_hz=50", "run.lead_s=1"}),
                        ActionKind::tau, {2.0, 1.0});
}

// The errors that it reports are those that the given twists are reported with.
TEST(Episode, OfTheTrackingLawsTwistsIsItsRunByteForByte) {
  for (const Overrides& trigger :
       {Overrides{}, Overrides{"controller.trigger=timer", "controller.rate_hz=20"},
        Overrides{"controller.pose_timeout_s=0.25"}}) {
    const Scenario scenario = scenario_with(both(both(kBad, trigger), {"controller.law=tracking"}));
    const Outcome run = run_of(scenario);
    EXPECT_GT(run.twists.size(), 50U);
    EXPECT_TRUE(episode_of(scenario, ActionKind::twist, run.twists).log == run.log);
  }
}

TEST(Episode, OfThePredictiveLawsPlansMovesTheVehicleAsItsRunDoes) {
  const Scenario scenario =
      scenario_with(both(kBad, {"controller.law=predictive", "actuator.policy=horizon",
                                "controller.horizon_s=5", "controller.trigger=timer"}));
  const Outcome run = run_of(scenario);
  EXPECT_GT(run.plans.size(), 300U);
  EXPECT_EQ(episode_of(scenario, ActionKind::plan, run.plans).epsilon_m, run.epsilon_m);
}

TEST(Episode, WithAnotherLookAheadIsTheRunWithThatOne) {
  const Outcome run = run_of(scenario_with(both(kBad, {"controller.tau_s=1.25"})));
  EXPECT_TRUE(episode_of(scenario_with(kBad), ActionKind::tau, {{1.25, 1.0}}).log == run.log);
}

TEST(Episode, WhereNothingIsSentLeavesTheVehicleStanding) {
  const Scenario scenario = scenario_with({});
  Episode episode(scenario, {ActionKind::send, {}});
  const std::vector<double> skip{0.0};
  while (!episode.is_over()) episode.step(skip);
  const Pose2 start = scenario.get<VehicleSettings>().start_pose();
  EXPECT_NEAR(episode.pose().pose.x_m, start.x_m, 0.1) << "noise of 0.02 m";
  EXPECT_NEAR(episode.pose().pose.y_m, start.y_m, 0.1);
}

TEST(Episode, WithoutAnyPoseIsOverInOneStepThatHasTheWholeReward) {
  Episode episode(scenario_with({"channel.prr=0"}), {ActionKind::twist, {}});
  EXPECT_TRUE(episode.is_over());
  episode.step(std::vector{0.0, 0.0});
  EXPECT_NEAR(episode.reward(), -20.0 * episode.metrics().epsilon_m(), 1e-9);
  EXPECT_LT(episode.reward(), -20.0);
}

double number(Episode& episode, const EpisodeSettings& settings, const std::string& name) {
  const std::vector<NumberSpace> space = observation_space(settings);
  std::vector<double> all(space.size());
  episode.observe(all);
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (space[i].name == name) return all[i];
  }
  ADD_FAILURE() << name;
  return NAN;
}

TEST(Episode, ObservesTheAgeOfWhatItKnows) {
  const Scenario scenario = scenario_with({"channel.delay_ms=60", "sensor.position_noise_m=0",
                                           "controller.trigger=timer", "controller.rate_hz=20"});
  const EpisodeSettings settings{ActionKind::twist, {}};
  Episode episode(scenario, settings);
  const std::vector<double> action{0.5, 0.1};
  // Poses are measured at 0, 0.1, … and arrive 60 ms later; decisions are at 0.1, 0.15, 0.2, …
  EXPECT_NEAR(to_seconds(episode.now()), 0.1, 1e-9);
  EXPECT_NEAR(number(episode, settings, "pose_age_s"), 0.1, 1e-9);
  EXPECT_NEAR(number(episode, settings, "pose_silence_s"), 0.04, 1e-9);
  episode.step(action);
  EXPECT_NEAR(number(episode, settings, "pose_age_s"), 0.15, 1e-9);
  EXPECT_NEAR(number(episode, settings, "pose_silence_s"), 0.09, 1e-9);
  EXPECT_NEAR(number(episode, settings, "sent_age_s"), 0.05, 1e-9);
  EXPECT_EQ(number(episode, settings, "sent_v_mps"), 0.5);
  EXPECT_EQ(number(episode, settings, "sent_omega_radps"), 0.1);
  episode.step(action);
  EXPECT_NEAR(number(episode, settings, "pose_age_s"), 0.1, 1e-9);
  EXPECT_EQ(number(episode, settings, "pose_reception"), 1.0);
}

TEST(Episode, ObservesThePathInTheVehiclesFrame) {
  const Scenario scenario = scenario_with(
      {"sensor.position_noise_m=0", "path.kind=line", "path.speed_mps=0.5", "path.length_m=10",
       "vehicle.start_x_m=-1", "vehicle.start_y_m=-2", "vehicle.start_yaw_rad=0"});
  const EpisodeSettings settings{ActionKind::twist, {4.0}};
  Episode episode(scenario, settings);
  EXPECT_NEAR(number(episode, settings, "ahead_m"), 1.0, 1e-6);
  EXPECT_NEAR(number(episode, settings, "left_m"), 2.0, 1e-6);
  EXPECT_NEAR(number(episode, settings, "heading_rad"), 0.0, 1e-6);
  // It begins at rest and takes 1 s to reach its speed.
  EXPECT_NEAR(number(episode, settings, "ahead_m@4"), 1.0 + 3.5 * 0.5, 1e-6);
  EXPECT_NEAR(number(episode, settings, "left_m@4"), 2.0, 1e-6);
  EXPECT_EQ(number(episode, settings, "path_v_mps"), 0.0);
}

TEST(Episode, KnowsOfAPlanOnBoardFromThePoseThatNamesIt) {
  const Scenario scenario = scenario_with({"controller.law=predictive", "actuator.policy=horizon",
                                           "controller.horizon_s=1", "channel.delay_ms=60"});
  const EpisodeSettings settings{ActionKind::plan, {}};
  Episode episode(scenario, settings);
  const std::vector<double> plan(2 * scenario.get<ControllerSettings>().plan_steps(), 0.1);
  // Poses of 0, 0.1, … arrive at 0.06, 0.16, …; the plan of 0.06 is on board at 0.12, which the
  // pose of 0.2 says at 0.26.
  for (const double age_s : {0.06, 0.16, 0.2, 0.2}) {
    EXPECT_NEAR(number(episode, settings, "acknowledged_age_s"), age_s, 1e-6);
    episode.step(plan);
  }
}

TEST(Episode, RefusesByNameWhatItsActionsDoNotGoWith) {
  const auto refusal = [](const Overrides& overrides, ActionKind kind) {
    return refusal_of([&] { check_actions(scenario_with(overrides), kind); });
  };
  EXPECT_EQ(refusal({}, ActionKind::twist), "accepted");
  EXPECT_EQ(refusal({}, ActionKind::plan),
            "controller.law: there are no actions \"plan\" with \"pid\"; allowed: predictive, "
            "predictive_consistent, mpc");
  EXPECT_EQ(refusal({"controller.law=tracking"}, ActionKind::tau),
            "controller.law: there are no actions \"tau\" with \"tracking\"; allowed: pid");
  EXPECT_EQ(refusal({"controller.law=predictive", "actuator.policy=horizon"}, ActionKind::twist),
            "controller.law: there are no actions \"twist\" with \"predictive\"; allowed: pid, "
            "pid_adaptive, tracking, tracking_compensated");
  EXPECT_EQ(refusal({"fleet.count=3"}, ActionKind::twist),
            "fleet.count: an environment has one vehicle; allowed: 1");
  EXPECT_EQ(refusal({"controller.estimator=ekf"}, ActionKind::twist),
            "controller.estimator: actions \"twist\" take the place of the law and its filter; "
            "allowed: none");
  EXPECT_EQ(
      refusal({"controller.law=predictive", "actuator.policy=horizon", "controller.preload=true"},
              ActionKind::plan),
      "controller.preload: no action makes the plan before departure; allowed: false");
  EXPECT_EQ(refusal_of([] { action_kind("wheel"); }),
            "action: there is no \"wheel\"; allowed: \"twist\", \"plan\", \"tau\", \"send\"");
}

TEST(Episode, RefusesActionsOutOfTheirSpaceAndNaN) {
  const std::vector<NumberSpace> space = action_space(scenario_with({}), ActionKind::twist);
  const auto refusal = [&](double v, double omega) {
    return refusal_of([&] { check_action(std::vector{v, omega}, space); });
  };
  EXPECT_EQ(refusal(8.0, -2.0), "accepted");
  EXPECT_EQ(refusal(8.5, 0.0), "action[0] (v_mps) is 8.5; allowed: a number in [-8, 8]");
  EXPECT_EQ(refusal(0.0, -2.5), "action[1] (omega_radps) is -2.5; allowed: a number in [-2, 2]");
  EXPECT_EQ(refusal(NAN, 0.0), "action[0] (v_mps) is nan; allowed: a number in [-8, 8]");
  EXPECT_EQ(refusal(0.0, INFINITY), "action[1] (omega_radps) is inf; allowed: a number in [-2, 2]");
}

}  // namespace
}  // namespace tether
