#include "tools/nodes/dashboard.hpp"

#include <fmt/ranges.h>
#include <gmock/gmock.h>

#include "tests/support/source_dir.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/runs/run_summary.hpp"

namespace tether {
namespace {

using ::testing::Contains;
using ::testing::ContainsRegex;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::MatchesRegex;
using ::testing::Not;
using ::testing::StartsWith;

struct Watched {
  explicit Watched(const std::vector<std::string>& more)
      : loop([&more] {
          std::vector<std::string> all{"vehicle.plant=kinematic", "sensor.rate_hz=10",
                                       "run.duration_s=10"};
          all.insert(all.end(), more.begin(), more.end());
          return load_scenario(in_source("/scenarios/paper.toml"), all);
        }()),
        observer(loop.members(), loop.loop(), loop.bus()),
        dashboard(loop.members().front()) {
    loop.run();
    moment.t_s = 10.0;
    moment.fleet = fleet_now(observer, loop.loop().now());
  }
  ClosedLoop loop;
  FleetObserver observer;
  Dashboard dashboard;
  Dashboard::Moment moment;
};

TEST(Dashboard, OfAFleetSaysHowAllStandAndWhoIsWorst) {
  Watched fleet({"fleet.count=3", "fleet.vehicle.2.channel.prr=0.2"});
  ASSERT_EQ(fleet.moment.fleet.size(), 2U);
  EXPECT_THAT(fleet.moment.fleet[0], MatchesRegex("ε [0-9.]+ m, worst [0-9.]+ m \\(AGV2\\)"));
  EXPECT_EQ(fleet.moment.fleet[1], "0 of 3 lost, 0 collisions");
  const auto lines = fleet.dashboard.lines(fleet.observer.first(), fleet.moment);
  EXPECT_LE(lines.size(), static_cast<std::size_t>(Dashboard::kRows));
  for (const std::string& said : fleet.moment.fleet) {
    EXPECT_THAT(lines, Contains(HasSubstr(said)));
  }
  EXPECT_THAT(lines, Contains(HasSubstr("AGV1: ε ")));
  EXPECT_THAT(fleet.dashboard.line(fleet.observer.first(), fleet.moment),
              StartsWith("   0 s left  " + fleet.moment.fleet[0] + "   0 of 3 lost"));
}

TEST(Dashboard, ShowsWhereTheOthersOfAFleetAre) {
  Watched fleet({"fleet.count=3"});
  const auto alone = fleet.dashboard.lines(fleet.observer.first(), fleet.moment);
  fleet.moment.others = {{10.0, -10.0}};
  EXPECT_NE(fleet.dashboard.lines(fleet.observer.first(), fleet.moment), alone);
}

TEST(Dashboard, OfOneVehicleSaysNothingOfAFleet) {
  Watched one({});
  EXPECT_TRUE(one.moment.fleet.empty());
  const auto lines = one.dashboard.lines(one.observer.first(), one.moment);
  EXPECT_THAT(fmt::format("{}", fmt::join(lines, "\n")), Not(HasSubstr("lost")));
}

TEST(Dashboard, InOneLineSaysWhatIsLeftWhereItIsHowFarOffAndWhatTheNetworkDidLately) {
  Watched one({});
  one.moment.t_s = 4.0;
  one.moment.uplink = {0.95, 120.4, 10.0};
  const ground_truth_t& truth = one.observer.first().truth();
  EXPECT_EQ(one.dashboard.line(one.observer.first(), one.moment),
            fmt::format("   6 s left  {:5.1f}, {:5.1f} m  error {:5.2f} m  up 0.95 120 ms  "
                        "down    -      -",
                        truth.x_m, truth.y_m, truth.error_m));
  one.moment.uplink = one.moment.downlink = {0.5, 9999.0, 10.0};
  EXPECT_LT(one.dashboard.line(one.observer.first(), one.moment).size(), 80U);
  one.moment.findings = {"something"};
  EXPECT_THAT(one.dashboard.line(one.observer.first(), one.moment), EndsWith("   INVALID"));
}

TEST(Dashboard, HasReceptionAndDelayOfTheLastSecondsBesideThoseOfTheRun) {
  Watched one({"channel.uplink.prr=0.5"});
  one.moment.uplink = {0.25, 80.0, 3.0};
  const auto lines = one.dashboard.lines(one.observer.first(), one.moment);
  EXPECT_THAT(lines, Contains(HasSubstr("in the last 10 s:")));
  EXPECT_THAT(lines, Contains(ContainsRegex("uplink    PRR 0.25   80 ms   3/s   run 0.[3-7]")));
  EXPECT_THAT(lines, Contains(HasSubstr("downlink  PRR    -       -   0/s   run 1.00")));
}

}  // namespace
}  // namespace tether
