#include "controller/laws/law.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "common/scenario/scenario.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/support/table_rows.hpp"

namespace tether {
namespace {

TEST(LawTable, HasARowForEachLawThatOurSourcesDefineOnce) {
  test::expect_has_all_rows(law_kinds(), "controller/laws", "LawKind", "_law");
}

TEST(LawTable, EachLawIsMadeByItsNameInAScenario) {
  for (const LawKind& kind : law_kinds()) {
    SCOPED_TRACE(kind.name);
    std::vector<std::string> overrides{
        "controller.law=" + kind.name,
        "controller.tau_table=" + in_source("/scenarios/tau_table.csv"),
        kind.sends_plans ? "actuator.policy=horizon" : "actuator.policy=hold"};
    if (kind.drives_on_request) {
      overrides.insert(overrides.end(), {"autonomy.enabled=true", "lidar.model=custom",
                                         "sensor.odometry_rate_hz=50"});
    }
    const Scenario scenario = parse_scenario("", "", overrides);
    EXPECT_EQ(&kind_of(scenario.get<ControllerSettings>()), &kind);
    const auto law = make_law(scenario);
    ASSERT_NE(law, nullptr);
    const SeenPose pose;
    law->on_pose(pose);
    EXPECT_EQ(std::holds_alternative<Plan>(law->decide(kStart, &pose)), kind.sends_plans);
  }
}

TEST(AdaptivePid, ItsLookAheadIsTheTablesTimesTheFactor) {
  const auto tau_ms = [](const std::string& factor) {
    const auto law =
        make_law(parse_scenario("", "",
                                {"controller.law=pid_adaptive", "controller.tau_factor=" + factor,
                                 "controller.tau_table=" + in_source("/scenarios/tau_table.csv")}));
    const SeenPose pose;
    law->on_pose(pose);
    CounterList counters;
    law->list_counters(counters);
    const auto found = std::find_if(counters.begin(), counters.end(), [](const auto& counter) {
      return counter.first == "law.tau_ms";
    });
    return found == counters.end() ? 0 : static_cast<int>(found->second);
  };
  EXPECT_GE(tau_ms("1"), 1000);
  EXPECT_EQ(tau_ms("0.5") * 2, tau_ms("1"));
}

}  // namespace
}  // namespace tether
