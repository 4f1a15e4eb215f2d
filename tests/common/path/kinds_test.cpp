#include "common/path/kinds.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "common/scenario/scenario.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/support/table_rows.hpp"

namespace tether {
namespace {

TEST(PathTable, HasARowForEachKindThatOurSourcesDefineOnce) {
  test::expect_has_all_rows(path_kinds(), "common/path", "PathKind", "_path");
}

TEST(PathTable, EachKindIsMadeByItsNameInAScenario) {
  for (const PathKind& kind : path_kinds()) {
    SCOPED_TRACE(kind.name);
    std::vector<std::string> overrides{"path.kind=" + kind.name};
    if (std::find(kind.keys.begin(), kind.keys.end(), "csv") != kind.keys.end()) {
      overrides.emplace_back("path.csv=" + in_source("/scenarios/paths/warehouse_lap.csv"));
    }
    const Scenario scenario = parse_scenario("", "", overrides);
    EXPECT_EQ(&kind_of(scenario.get<PathSettings>()), &kind);
    const auto path = make_path(scenario.get<PathSettings>());
    ASSERT_NE(path, nullptr);
    EXPECT_TRUE(std::isfinite(path->at(1.0).x_m));
  }
}

}  // namespace
}  // namespace tether
