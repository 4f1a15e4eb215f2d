#include <gtest/gtest.h>

#include "common/scenario/scenario.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/runs/metric.hpp"
#include "tools/runs/run_observer.hpp"

// Loops in which only what changes is sent.

namespace tether {
namespace {

struct Driven {
  double settled_epsilon_m;
  link_report_t up, down;
  std::map<std::string, std::int64_t> counters;
};

Driven drive(std::vector<std::string> overrides) {
  overrides.insert(overrides.begin(), {"vehicle.plant=kinematic", "sensor.rate_hz=20"});
  const Scenario scenario = load_scenario(in_source("/scenarios/paper.toml"), overrides);
  ClosedLoop loop(scenario);
  const RunObserver observer(scenario, loop.loop(), loop.bus());
  loop.run();
  return {observer.truth().settled_epsilon_m, observer.uplink(), observer.downlink(),
          observer.counters()};
}

const std::vector<std::string> kPlans{"controller.law=predictive_consistent",
                                      "actuator.policy=horizon"};

std::vector<std::string> plans(std::vector<std::string> overrides) {
  overrides.insert(overrides.begin(), kPlans.begin(), kPlans.end());
  return overrides;
}

TEST(SendingChangesInALoop, OfPlansLeavesTheVehicleOnItsPath) {
  const Driven all = drive(plans({}));
  const Driven few = drive(plans({"controller.send=changed"}));
  EXPECT_LT(all.settled_epsilon_m, 0.01);
  EXPECT_LT(few.settled_epsilon_m, 0.01);
  EXPECT_LT(5 * few.down.offered, all.down.offered);
}

// Messages that are not sent are not lost: the network is offered what was sent, and the receiver
// misses what the network lost of that.
TEST(SendingChangesInALoop, CountsNothingAsLostThatWasNotSent) {
  const Driven run = drive({"sensor.send=changed", "controller.send=changed", "channel.prr=0.7",
                            "controller.trigger=timer", "sensor.send_max_age_s=0.2"});
  const auto& counters = run.counters;
  EXPECT_EQ(run.up.offered, counters.at("sim.pose.sent"));
  EXPECT_EQ(run.down.offered, counters.at("controller.command.sent"));
  EXPECT_LT(run.up.offered, counters.at("sim.pose.sampled"));
  EXPECT_LT(run.down.offered, counters.at("controller.command.decided"));
  EXPECT_LE(counters.at("controller.pose.missed"), run.up.lost);
  EXPECT_LE(counters.at("sim.command.missed"), run.down.lost);
  EXPECT_GE(counters.at("controller.pose.missed"), run.up.lost - 20) << "the last ones";
}

// A plan is sent once and lost in 7 of 10 cases; poses say so, and it is sent again.
TEST(SendingChangesInALoop, OfPlansMendsLossesLongBeforeTheAgeLimit) {
  const Driven run = drive(plans(
      {"controller.send=changed", "controller.send_max_age_s=15", "channel.downlink.prr=0.3"}));
  EXPECT_LT(run.settled_epsilon_m, 0.02);
  EXPECT_LT(run.down.offered, 150);
}

// ------------------------------------------------------------------ what docs/explanation/fleet.md
// concludes

struct AtAccessPoint {
  double epsilon_m, busy;
};

/// Four vehicles that never meet, with noisy poses, sampled 20 times a second unless said
/// otherwise.
AtAccessPoint fleet(std::vector<std::string> overrides) {
  overrides.insert(overrides.begin(), {"vehicle.plant=kinematic", "world.half_extent_m=400",
                                       "fleet.count=4", "fleet.phases=none", "fleet.offset_x_m=50",
                                       "medium.model=dcf", "sensor.position_noise_m=0.02",
                                       "sensor.yaw_noise_rad=0.01", "sensor.rate_hz=20"});
  const Scenario scenario = load_scenario(in_source("/scenarios/paper.toml"), overrides);
  ClosedLoop loop(scenario);
  const FleetObserver observer(loop.members(), loop.loop(), loop.bus());
  loop.run();
  const auto metric = [&](const char* name) {
    return value_of(metrics()[*metric_number(name)], observer.vehicles(), loop.loop().now());
  };
  return {metric("settled_epsilon_m"), metric("medium_busy")};
}

TEST(SendingChangesAtAnAccessPoint, OfPlansTakesLessThanHalfTheAirtimeAtNoMoreError) {
  const auto with = [](std::vector<std::string> more) {
    more.insert(more.end(), {"controller.trigger=timer", "controller.rate_hz=20",
                             "controller.plan_step_ms=150", "controller.tracking.k_x=1.93",
                             "controller.tracking.k_y=1.02", "controller.tracking.k_theta=1.4"});
    return fleet(plans(more));
  };
  const AtAccessPoint always = with({"sensor.rate_hz=2"});
  const AtAccessPoint changed =
      with({"sensor.send=changed", "sensor.send_delta_m=0.4", "sensor.send_delta_rad=0.4",
            "sensor.send_max_age_s=0.9", "controller.send=changed", "controller.send_max_age_s=5"});
  EXPECT_GT(always.busy, 0.0);
  EXPECT_LT(changed.busy, 0.5 * always.busy);
  EXPECT_LT(changed.epsilon_m, always.epsilon_m);
}

TEST(SendingChangesAtAnAccessPoint, OfPosesThatArePidsIsNoBetterThanALowerRate) {
  const auto with = [](std::vector<std::string> more) {
    more.insert(more.end(), {"controller.tau_s=1", "controller.v.p=1", "controller.v.d=0.001",
                             "controller.omega.p=2", "controller.omega.d=0.001"});
    return fleet(more);
  };
  const AtAccessPoint seldom = with({"sensor.rate_hz=5"});
  const AtAccessPoint changed = with({"sensor.send=changed", "sensor.send_delta_m=0.1"});
  EXPECT_GT(changed.busy, 2.0 * seldom.busy);
  EXPECT_GT(changed.epsilon_m, seldom.epsilon_m);
}

}  // namespace
}  // namespace tether
