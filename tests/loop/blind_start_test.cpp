#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <string>
#include <tether/controller_report_t.hpp>
#include <tether/ground_truth_t.hpp>
#include <utility>
#include <vector>

#include "common/node/message_io.hpp"
#include "common/vehicle/actuator_policy.hpp"
#include "controller/laws/law.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/nodes/closed_loop.hpp"

// Loops in which no pose ever reaches the controller.

namespace tether {
namespace {

using Overrides = std::vector<std::string>;

/// Where the vehicle was, and when it last moved.
struct Drive {
  double way_m = 0.0;
  double moved_until_s = 0.0;
  std::int64_t timeouts = 0;
};

Drive drive(const std::string& file, const Overrides& overrides) {
  ClosedLoop loop(load_scenario(in_source("/scenarios/" + file), overrides));
  Drive out;
  std::optional<ground_truth_t> last;
  std::int64_t undecodable = 0;
  subscribe<ground_truth_t>(
      loop.bus(), "SIM/TRUTH", kDeepQueue, undecodable, [&](const ground_truth_t& m) {
        const double step_m = last ? std::hypot(m.x_m - last->x_m, m.y_m - last->y_m) : 0.0;
        if (step_m > 1e-9) out.moved_until_s = to_seconds(from_utime(m.utime));
        out.way_m += step_m;
        last = m;
      });
  subscribe<controller_report_t>(
      loop.bus(), "CTRL/REPORT", kDeepQueue, undecodable,
      [&](const controller_report_t& m) { out.timeouts += m.pose_timed_out; });
  loop.run();
  EXPECT_EQ(undecodable, 0);
  return out;
}

Overrides without_poses(const Overrides& more) {
  Overrides all{"vehicle.plant=kinematic", "vehicle.max_wheel_acceleration_mps2=4",
                "run.duration_s=15",       "channel.uplink.prr=0",
                "controller.rate_hz=10",   "controller.pose_timeout_s=1",
                "sensor.rate_hz=10"};
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

/// All laws by all policies that take their output, but the remote driver, which never begins.
std::vector<std::pair<const LawKind*, std::string>> laws_and_policies() {
  std::vector<std::pair<const LawKind*, std::string>> all;
  for (const LawKind& law : law_kinds()) {
    if (law.drives_on_request) continue;
    for (const ActuatorPolicy& policy : actuator_policies()) {
      if (law.sends_plans && !policy.takes_plans) continue;
      all.emplace_back(&law, policy.name);
    }
  }
  return all;
}

Overrides of(const LawKind& law, const std::string& policy, const std::string& trigger) {
  return {"controller.law=" + law.name, "actuator.policy=" + policy,
          "controller.trigger=" + trigger};
}

// It plans from the known start for pose_timeout_s, and brakes then: at most 2.8 m/s, at 1 m/s^2.
TEST(BlindStart, NoLawByAnyPolicyDrivesLongerThanThePoseTimeout) {
  int moved = 0;
  for (const auto& [law, policy] : laws_and_policies()) {
    for (const char* trigger : {"timer", "event"}) {
      for (const char* preload : {"false", "true"}) {
        if (!law->sends_plans && std::string(preload) == "true") continue;
        Overrides keys = of(*law, policy, trigger);
        if (law->sends_plans) keys.push_back(std::string("controller.preload=") + preload);
        SCOPED_TRACE(::testing::PrintToString(keys));
        const Drive run = drive("paper.toml", without_poses(keys));
        EXPECT_LT(run.moved_until_s, 5.0);
        EXPECT_LT(run.way_m, 5.0);
        EXPECT_GT(run.timeouts, 0);
        if (!law->sends_plans) {
          EXPECT_EQ(run.way_m, 0.0);
        }
        moved += run.way_m > 0.1 ? 1 : 0;
      }
    }
  }
  EXPECT_GE(moved, 3) << "laws that plan do so from a known start";
}

TEST(BlindStart, AnEstimatorThatHearsWheelsAloneDoesNotDrive) {
  for (const auto& [law, policy] : laws_and_policies()) {
    Overrides keys = of(*law, policy, "timer");
    keys.insert(keys.end(), {"controller.estimator=ekf", "sensor.odometry_rate_hz=50"});
    SCOPED_TRACE(::testing::PrintToString(keys));
    EXPECT_LT(drive("paper.toml", without_poses(keys)).moved_until_s, 5.0);
  }
}

TEST(BlindStart, ANullControlThatDrivesBlindSaysSoByATimeoutOfZero) {
  const Drive run =
      drive("paper.toml",
            without_poses({"controller.law=predictive_consistent", "actuator.policy=horizon",
                           "controller.trigger=timer", "controller.pose_timeout_s=0"}));
  EXPECT_EQ(run.timeouts, 0);
  EXPECT_GT(run.moved_until_s, 14.9);
}

// The localiser of this seed and place finds nothing in 14 s.
TEST(BlindStart, WhereTheStartIsUnknownThereIsNoPlanFromIt) {
  const Overrides lost{"localiser.knows_start=false", "path.phase=0.7", "run.seed=141",
                       "run.duration_s=14", "vehicle.plant=kinematic"};
  for (const char* timeout_s : {"1", "0"}) {
    SCOPED_TRACE(timeout_s);
    Overrides keys = lost;
    keys.push_back(std::string("controller.pose_timeout_s=") + timeout_s);
    EXPECT_EQ(drive("factory.toml", keys).way_m, 0.0);
  }
}

TEST(BlindStart, APreloadedPlanFromAnUnknownStartIsRefused) {
  const auto refusal = refusal_of([] {
    load_scenario(in_source("/scenarios/factory.toml"),
                  {"localiser.knows_start=false", "controller.preload=true"});
  });
  EXPECT_NE(refusal.find("controller.preload = true plans from the start, which is unknown"),
            std::string::npos)
      << refusal;
}

TEST(PoseTimeout, ThatNoPoseCanMeetIsSaidAtLoad) {
  const auto warnings = [](const char* timeout, const char* delay) {
    return scenario_warnings(load_scenario(in_source("/scenarios/paper.toml"),
                                           {std::string("controller.pose_timeout_s=") + timeout,
                                            std::string("channel.uplink.delay_ms=") + delay,
                                            "sensor.latency_ms=20", "sensor.rate_hz=20"}));
  };
  ASSERT_EQ(warnings("0.04", "30").size(), 1U);
  EXPECT_EQ(warnings("0.04", "30")[0],
            "controller.pose_timeout_s = 0.04 is not above the 0.05 s that a pose takes "
            "(sensor.latency_ms and the uplink's delay): every pose is too old, the vehicle never "
            "drives");
  ASSERT_EQ(warnings("0.08", "30").size(), 1U);
  EXPECT_NE(warnings("0.08", "30")[0].find("the vehicle stops before each of them"),
            std::string::npos);
  EXPECT_EQ(warnings("0.12", "30").size(), 0U);
  EXPECT_EQ(warnings("0", "30").size(), 0U) << "never";
}

}  // namespace
}  // namespace tether
