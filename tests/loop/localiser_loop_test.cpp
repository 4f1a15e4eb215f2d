// Poses from scans in the whole loop: on the vehicle, and at the edge behind a network that loses
// parts of scans.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <tether/ground_truth_t.hpp>
#include <tether/localisation_t.hpp>
#include <tether/pose_t.hpp>
#include <vector>

#include "common/vehicle/frames.hpp"
#include "sim/node/sim_node.hpp"
#include "tests/loop/lockstep_rig.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/nodes/closed_loop.hpp"

namespace tether {
namespace {

using test::LockstepRig;
using test::record_of;

constexpr char kHall[] = R"(
[run]
duration_s = 20
[world]
half_extent_m = 14.0
[[world.obstacle]]
kind = "box"
x_m = 8.0
y_m = 7.0
length_m = 3.0
width_m = 1.5
[[world.obstacle]]
kind = "rack"
x_m = -6.0
y_m = -8.0
length_m = 8.0
width_m = 1.2
[[world.obstacle]]
kind = "cylinder"
x_m = 9.0
y_m = -4.0
radius_m = 0.3
[vehicle]
plant = "kinematic"
[path]
kind = "circle"
radius_m = 4.0
speed_mps = 1.0
[sensor]
odometry_rate_hz = 50
[lidar]
model = "custom"
[controller]
law = "tracking"
)";

Scenario scenario(const std::vector<std::string>& more) {
  return parse_scenario(kHall, "hall.toml", more);
}

/// A run, and what the localiser said.
struct LocalisedRun {
  explicit LocalisedRun(const Scenario& scenario) : loop(scenario) {
    const bool at_edge = scenario.get<LocaliserSettings>().place == LocaliserSettings::Place::edge;
    subscribe<localisation_t>(loop.bus(), at_edge ? "CTRL/LOCALISATION" : "AGV/LOCALISATION",
                              kDeepQueue, undecodable,
                              [this](const localisation_t& m) { take(m); });
    subscribe<pose_t>(loop.bus(), "CTRL/POSE", kDeepQueue, undecodable,
                      [this](const pose_t&) { ++poses; });
    loop.run();
  }
  void take(const localisation_t& m) {
    if (m.state == localisation_t::SEARCHING) ++searching;
  }

  ClosedLoop loop;
  std::int64_t undecodable = 0;
  int searching = 0, poses = 0;
};

/// How far localisations on the vehicle are off the truth, which is linear between two messages.
class LocalisationErrors {
 public:
  explicit LocalisationErrors(Bus& bus) {
    subscribe<ground_truth_t>(bus, "SIM/TRUTH", kDeepQueue, undecodable_,
                              [this](const ground_truth_t& m) { truths_.push_back(m); });
    subscribe<localisation_t>(bus, "AGV/LOCALISATION", kDeepQueue, undecodable_,
                              [this](const localisation_t& m) { found_.push_back(m); });
  }

  struct Summary {
    std::size_t count = 0;
    double rms_m = 0.0, rms_rad = 0.0, largest_m = 0.0;
    double nees = 0.0;  ///< mean normalised error squared: 3 if covariances are right
  };
  Summary summary() const {
    Summary out;
    for (const localisation_t& m : found_) {
      const auto after =
          std::upper_bound(truths_.begin(), truths_.end(), m.utime,
                           [](std::int64_t t, const ground_truth_t& g) { return t < g.utime; });
      if (after == truths_.begin() || after == truths_.end()) continue;
      const Pose2 truth = between(*std::prev(after), *after, m.utime);
      const Pose2 off = relative_to(truth, {m.x_m, m.y_m, m.yaw_rad});
      const Eigen::Vector3d error(m.x_m - truth.x_m, m.y_m - truth.y_m, off.yaw_rad);
      out.nees += error.dot(covariance_of(m).ldlt().solve(error));
      const double off_m = std::hypot(off.x_m, off.y_m);
      ++out.count;
      out.rms_m += off_m * off_m;
      out.rms_rad += off.yaw_rad * off.yaw_rad;
      out.largest_m = std::max(out.largest_m, off_m);
    }
    out.nees /= static_cast<double>(out.count);
    out.rms_m = std::sqrt(out.rms_m / static_cast<double>(out.count));
    out.rms_rad = std::sqrt(out.rms_rad / static_cast<double>(out.count));
    return out;
  }

 private:
  static Eigen::Matrix3d covariance_of(const localisation_t& m) {
    return Eigen::Matrix3d{{m.cov_x_x_m2, m.cov_x_y_m2, m.cov_x_yaw_m_rad},
                           {m.cov_x_y_m2, m.cov_y_y_m2, m.cov_y_yaw_m_rad},
                           {m.cov_x_yaw_m_rad, m.cov_y_yaw_m_rad, m.cov_yaw_yaw_rad2}};
  }
  static Pose2 between(const ground_truth_t& a, const ground_truth_t& b, std::int64_t utime) {
    const double share =
        static_cast<double>(utime - a.utime) / static_cast<double>(b.utime - a.utime);
    const Pose2 from{a.x_m, a.y_m, a.yaw_rad};
    const Pose2 step = relative_to(from, {b.x_m, b.y_m, b.yaw_rad});
    return compose(from, {share * step.x_m, share * step.y_m, share * step.yaw_rad});
  }

  std::int64_t undecodable_ = 0;
  std::vector<ground_truth_t> truths_;
  std::vector<localisation_t> found_;
};

TEST(LocaliserLoop, ALocalisedVehicleFollowsItsPath) {
  LocalisedRun run(scenario({"localiser.place=vehicle"}));
  EXPECT_EQ(run.searching, 0);
  EXPECT_LT(run.loop.sim().metrics().epsilon_m(), 0.1);
}

TEST(LocaliserLoop, AtTheEdgeScansGoThroughTheNetworkInParts) {
  LocalisedRun good(scenario({"localiser.place=edge"}));
  EXPECT_GT(good.poses, 250);
  EXPECT_LT(good.loop.sim().metrics().epsilon_m(), 0.1);
  LocalisedRun bad(
      scenario({"localiser.place=edge", "channel.prr=0.5", "localiser.part_bytes=600"}));
  EXPECT_GT(bad.poses, 150);
  EXPECT_EQ(bad.searching, 0);
  EXPECT_LT(bad.loop.sim().metrics().epsilon_m(), 0.3);
}

TEST(LocaliserLoop, AVehicleThatDoesNotKnowWhereItIsStandsUntilItDoes) {
  LocalisedRun run(scenario(
      {"localiser.place=vehicle", "localiser.knows_start=false", "controller.pose_timeout_s=0.5"}));
  EXPECT_GT(run.searching, 0);
  EXPECT_LT(run.searching, 75);
}

TEST(LocaliserLoop, AScannerThatSeesNothingOfTheMapOrTooLittleIsRefused) {
  const auto refusal = [](const char* key) {
    return refusal_of([&] { scenario({"localiser.place=vehicle", key}); });
  };
  EXPECT_THAT(refusal("lidar.height_m=100"),
              ::testing::HasSubstr("localiser.scan_height_m = 100: the map shows nothing"));
  EXPECT_THAT(refusal("lidar.beams=19"), ::testing::HasSubstr("lidar.beams = 19, at least 20"));
}

/// Aisles that look the same, and people that the map does not have.
TEST(LocaliserLoop, InTheFactoryAVehicleThatKnowsNothingIsFoundWhereItIsOrNotAtAll) {
  for (const char* y_m : {"3", "9", "15"}) {
    SCOPED_TRACE(y_m);
    const std::string y = std::string("start_y_m=") + y_m;
    ClosedLoop loop(load_scenario(
        in_source("/scenarios/factory.toml"),
        {"vehicle.plant=kinematic", "run.duration_s=8", "localiser.knows_start=false",
         "path.kind=line", "path.length_m=2", "path.start_x_m=-12", "path." + y,
         "vehicle.start_x_m=-12", "vehicle." + y, "channel.model=fixed", "channel.prr=0"}));
    std::int64_t undecodable = 0, heard = 0;
    subscribe<localisation_t>(
        loop.bus(), "AGV/LOCALISATION", kDeepQueue, undecodable, [&](const localisation_t& found) {
          ++heard;
          if (found.state == localisation_t::SEARCHING) return;
          const Pose2 truth = loop.sim().vehicle().state().pose;
          EXPECT_LT(std::hypot(found.x_m - truth.x_m, found.y_m - truth.y_m), 0.2);
        });
    loop.run();
    EXPECT_GT(heard, 100);
  }
}

TEST(LocaliserLoop, OnALapThroughTheFactoryItIsWithin3CmAndHalfADegree) {
  const Scenario factory = load_scenario(in_source("/scenarios/factory.toml"),
                                         {"vehicle.plant=kinematic", "run.duration_s=157"});
  ClosedLoop loop(factory);
  const LocalisationErrors errors(loop.bus());
  loop.run();
  const auto found = errors.summary();
  EXPECT_GT(found.count, 2300U);  // 15 a second
  EXPECT_LT(found.rms_m, 0.03);
  EXPECT_LT(found.rms_rad, 0.5 * std::numbers::pi / 180.0);
  EXPECT_LT(found.largest_m, 0.1);
  EXPECT_LT(loop.sim().metrics().epsilon_m(), 0.02);
  RecordProperty("rms_mm", std::to_string(1e3 * found.rms_m));
  RecordProperty("rms_mrad", std::to_string(1e3 * found.rms_rad));
  RecordProperty("largest_mm", std::to_string(1e3 * found.largest_m));
}

// Its errors are of one run, and of slip that does not change from scan to scan: so there is a
// bound from above only.
TEST(LocaliserLoop, OnTyresThatSlipInACurveItDoesNotTakeItselfForSurerThanItIs) {
  ClosedLoop loop(load_scenario(in_source("/scenarios/factory.toml"), {"run.duration_s=12"}));
  const LocalisationErrors errors(loop.bus());
  loop.run();
  EXPECT_LT(errors.summary().nees, 3.0);
  EXPECT_LT(errors.summary().largest_m, 0.02);
}

TEST(LocaliserLoop, IsTheSameInLockstep) {
  for (const char* place : {"vehicle", "edge"}) {
    const Scenario s = scenario({std::string("localiser.place=") + place, "run.duration_s=2",
                                 "channel.prr=0.8", "channel.delay_ms=20"});
    LockstepRig rig(s);
    rig.run();
    ASSERT_EQ(rig.manager->error(), "");
    EXPECT_TRUE(rig.record == record_of(s));
  }
}

}  // namespace
}  // namespace tether
