#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <tether/counters_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <tether/ground_truth_t.hpp>
#include <tether/plan_t.hpp>
#include <tether/pose_t.hpp>
#include <utility>
#include <vector>

#include "common/node/in_process_bus.hpp"
#include "common/node/message_io.hpp"
#include "common/node/virtual_loop.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "netem/relay/netem_node.hpp"
#include "sim/node/sim_node.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/support/virtual_world.hpp"
#include "tools/nodes/can_loop.hpp"

// Plans through the relay to the shipping bridge, emulated drives and simulated wheels: the horizon
// is executed on the vehicle's side of the network, and poses name the plan in force.

namespace tether {
namespace {

using test::at_s;
using test::counter;
using test::Seen;

/// Plans, and as much of a budget for blind driving as simulated drives may have.
Scenario planned_hil(const std::vector<std::string>& overrides) {
  std::vector<std::string> all{"actuator.policy=horizon", "can.max_blind_s=10",
                               "can.max_blind_m=100"};
  all.insert(all.end(), overrides.begin(), overrides.end());
  return load_scenario(in_source("/scenarios/hil_vcan.toml"), all);
}

/// With the budget as it is by default.
Scenario floor_plan(const std::vector<std::string>& overrides) {
  std::vector<std::string> all{"can.max_blind_s=1", "can.max_blind_m=1", "run.duration_s=25"};
  all.insert(all.end(), overrides.begin(), overrides.end());
  return planned_hil(all);
}

/// Actions of the planner, and their end.
struct Plans {
  int twists = 60;                  ///< number of twists of 50 ms
  Instant silent = Instant::max();  ///< sends no more
  Instant blind = Instant::max();   ///< sees no more, and extends its plans
  bool any = false;                 ///< based on any, so that none is refused as inconsistent
};

/// Answers each pose with a plan of 3 s: standstill before t = 0, then `twist`; consistent.
class Planner {
 public:
  Planner(EventLoop& loop, Bus& bus, Twist twist, const Plans& plans)
      : loop_(loop), bus_(bus), twist_(twist), plans_(plans) {
    subscribe<pose_t>(bus, "CTRL/POSE", 1, undecodable_, [this](const pose_t& m) {
      if (loop_.now() < plans_.blind) seen_ = m;
      answer(seen_);
    });
  }

 private:
  void answer(const pose_t& pose) {
    if (loop_.now() >= plans_.silent) return;
    plan_t m{};
    m.utime = m.start_utime = to_utime(loop_.now());
    m.seq = m.id = next_++;
    m.session = 11;
    const bool blind = loop_.now() >= plans_.blind;
    m.based_on = blind || plans_.any              ? plan_t::ANY
                 : pose.plan_session == m.session ? pose.plan_id
                                                  : plan_t::NONE;
    m.based_on_last = m.based_on;
    m.pose_utime = pose.utime;
    m.step_us = 50'000;
    m.count = plans_.twists;
    for (int k = 0; k < m.count; ++k) {
      const bool lead = m.start_utime + std::int64_t{k} * m.step_us < 0;
      m.v_mps.push_back(lead ? 0.0F : static_cast<float>(twist_.v_mps));
      m.omega_radps.push_back(lead ? 0.0F : static_cast<float>(twist_.omega_radps));
    }
    publish(bus_, "CTRL/PLAN", m);
  }

  EventLoop& loop_;
  Bus& bus_;
  Twist twist_;
  Plans plans_;
  pose_t seen_{};
  std::int64_t next_ = 0;
  std::int64_t undecodable_ = 0;
};

struct PlannedDrive {
  explicit PlannedDrive(const Scenario& scenario, const Plans& plans = {}, Twist twist = {1.0, 0.1})
      : loop(kStart - from_seconds(scenario.get<RunSettings>().lead_s)),
        bus(loop),
        sim(scenario, loop, bus),
        netem(scenario, loop, bus, bus),
        planner(loop, bus, twist, plans) {
    if (scenario.get<VehicleSettings>().drivetrain == VehicleSettings::Drivetrain::can) {
      can = std::make_unique<CanLoop>(scenario, loop, bus);
    }
    collect("AGV/POSE", poses);
    collect("SIM/TRUTH", truths);
    collect("CAN/STATE", states);
    collect(can ? "CAN/COUNTERS" : "SIM/COUNTERS", counters);
    loop.run_until(kStart + from_seconds(scenario.get<RunSettings>().duration_s));
    sim.finish();
    if (can) can->finish();
    loop.run_until(loop.now());
  }

  template <class LcmType>
  void collect(const std::string& channel, std::vector<Seen<LcmType>>& out) {
    subscribe<LcmType>(bus, channel, kDeepQueue, undecodable, [this, &out](const LcmType& m) {
      out.push_back({loop.now(), m});
    });
  }
  std::int64_t count(const std::string& name) const {
    return counter(counters.back().message, name);
  }
  /// Until both wheels stood, from `since` on, and the way of the axle's midpoint till then.
  std::pair<double, double> rest_after(Instant since) const {
    double way_m = 0.0;
    Instant before = since;
    for (const auto& [when, m] : truths) {
      if (when < since) continue;
      way_m += std::abs(m.v_mps) * to_seconds(when - before);
      before = when;
      if (std::max(std::abs(m.left_rim_mps), std::abs(m.right_rim_mps)) < 1e-3) {
        return {to_seconds(when - since), way_m};
      }
    }
    return {1e9, 1e9};
  }
  double speed_at(Instant t) const {
    for (const auto& [when, m] : truths) {
      if (when >= t) return m.v_mps;
    }
    return -1.0;
  }
  Pose2 pose() { return sim.vehicle().state().pose; }

  VirtualLoop loop;
  InProcessBus bus;
  SimNode sim;
  NetemNode netem;
  Planner planner;
  std::unique_ptr<CanLoop> can;
  std::int64_t undecodable = 0;
  std::vector<Seen<pose_t>> poses;
  std::vector<Seen<ground_truth_t>> truths;
  std::vector<Seen<drivetrain_state_t>> states;
  std::vector<Seen<counters_t>> counters;
};

TEST(CanPlanLoop, GoesTheWayOfTheDirectRun) {
  PlannedDrive can(planned_hil({"run.duration_s=10"}));
  PlannedDrive direct(planned_hil({"run.duration_s=10", "vehicle.drivetrain=direct"}));
  EXPECT_EQ(can.states.back().message.state, drivetrain_state_t::ARMED);
  EXPECT_EQ(can.states.back().message.disarms, 0);
  ASSERT_GT(std::hypot(direct.pose().x_m, direct.pose().y_m), 5.0);
  // The bridge's cycle, jerk limits and the drives' ramps take some 50 ms at 1 m/s.
  EXPECT_NEAR(can.pose().x_m, direct.pose().x_m, 0.15);
  EXPECT_NEAR(can.pose().y_m, direct.pose().y_m, 0.15);
  EXPECT_GT(direct.count("plan.accepted"), 100);
}

TEST(CanPlanLoop, PosesNameThePlanThatOnlyTheBridgeKnows) {
  const PlannedDrive run(planned_hil({"run.duration_s=5"}));
  EXPECT_EQ(run.poses.front().message.plan_id, -1);
  std::int64_t last = -1, named = 0;
  for (const auto& [when, m] : run.poses) {
    EXPECT_GE(m.plan_id, last);
    EXPECT_EQ(m.plan_session, m.plan_id < 0 ? -1 : 11);
    named += m.plan_id > last ? 1 : 0;
    last = m.plan_id;
  }
  EXPECT_GT(named, 50) << "of 200 poses";
  // A pose that was taken before the bridge had told is answered with a plan that it refuses.
  EXPECT_EQ(run.count("plan.received"),
            run.count("plan.accepted") + run.count("plan.inconsistent"));
  EXPECT_GT(run.count("plan.accepted"), 50);
}

TEST(CanPlanLoop, APlanOutlivesTheNetworkAndThenTheLadderOfOldCommandsCounts) {
  PlannedDrive run(planned_hil({"run.duration_s=10"}),
                   {.silent = at_s(4)});  // the last plan ends just before t = 7
  Instant slowing{}, disarmed{};
  for (const auto& [when, m] : run.states) {
    if (when < at_s(4)) continue;
    if (when < at_s(6.8)) {
      EXPECT_NEAR(m.v_mps, 1.0, 1e-6) << to_seconds(when);
    }
    if (slowing == Instant{} && m.v_mps < 0.99) slowing = when;
    if (disarmed == Instant{} && m.state != drivetrain_state_t::ARMED) disarmed = when;
  }
  EXPECT_NEAR(to_seconds(slowing), 7.0, 0.12);
  EXPECT_NEAR(to_seconds(disarmed), 7.5, 0.1);
  EXPECT_NEAR(run.sim.vehicle().state().twist.v_mps, 0.0, 0.01);
  EXPECT_EQ(run.states.back().message.disarms, 1);
}

// A twist is 150 ms old when it comes, and the next in 0.3 s on average: with these, hil_vcan.toml
// as it is does not even arm.
TEST(CanPlanLoop, LossAndDelayThatStopTwistsDoNotStopPlans) {
  PlannedDrive run(planned_hil({"run.duration_s=20", "channel.prr=0.4", "channel.delay_ms=150"}));
  EXPECT_EQ(run.states.back().message.disarms, 0);
  EXPECT_EQ(run.states.back().message.state, drivetrain_state_t::ARMED);
  EXPECT_NEAR(run.sim.vehicle().state().twist.v_mps, 1.0, 0.02);
  EXPECT_GT(run.count("plan.accepted"), 5);
}

// The budget is counted from the pose that the newest plan was made from. The wheels of the vehicle
// stand later than the bridge's setpoints by what the drives lag behind.
TEST(CanPlanLoop, WithBothLinksDeadTheVehicleStandsWithinTheBudget) {
  for (const double v_mps : {0.5, 1.0, 3.0}) {
    const PlannedDrive run(floor_plan({}), {.twists = 2000, .silent = at_s(20)},
                           {v_mps, v_mps / 3.0});
    const auto [s, m] = run.rest_after(at_s(20));
    std::printf("measured: both links dead at %.1f m/s: stands after %.2f s, %.2f m\n",
                run.speed_at(at_s(20)), s, m);
    EXPECT_LE(s, 1.0);
    EXPECT_LE(m, 1.0);
    EXPECT_EQ(run.states.back().message.disarms, 1);
  }
}

TEST(CanPlanLoop, WithTheUplinkDeadPlansFromAnOldPoseDoNotProlongTheBudget) {
  const PlannedDrive run(floor_plan({}), {.twists = 2000, .blind = at_s(20)}, {3.0, 1.0});
  const auto [s, m] = run.rest_after(at_s(20));
  std::printf("measured: uplink dead at %.1f m/s: stands after %.2f s, %.2f m\n",
              run.speed_at(at_s(20)), s, m);
  EXPECT_LE(s, 1.0);
  EXPECT_LE(m, 1.0);
  EXPECT_EQ(run.states.back().message.disarms, 1);
}

TEST(CanPlanLoop, WithPosesDeadFromTheStartTheVehicleNeverMoves) {
  const PlannedDrive run(floor_plan({}), {.twists = 2000, .blind = Instant::min()}, {3.0, 0.0});
  EXPECT_NEAR(run.truths.back().message.x_m, run.truths.front().message.x_m, 1e-6);
  EXPECT_GT(run.count("plan.without_pose") + run.count("plan.blind"), 400);
}

TEST(CanPlanLoop, HalfASecondOfDelaySlowsButDoesNotStop) {
  const PlannedDrive run(floor_plan({"channel.delay_ms=250"}), {.any = true}, {3.0, 1.0});
  EXPECT_EQ(run.states.back().message.state, drivetrain_state_t::ARMED);
  EXPECT_EQ(run.states.back().message.disarms, 0);
  std::printf("measured: 250 ms each way: %.2f m/s\n", run.speed_at(at_s(20)));
  // 3 m/s^2 * (1 - 0.5 - 0.18) s, less what pose and cycle add to the age.
  EXPECT_NEAR(run.speed_at(at_s(20)), 0.88, 0.1);
}

}  // namespace
}  // namespace tether
