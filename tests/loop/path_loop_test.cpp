#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/path/planned_path.hpp"
#include "common/scenario/run_settings.hpp"
#include "sim/node/sim_node.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/tools/runs/run_files.hpp"
#include "tools/nodes/closed_loop.hpp"

namespace fs = std::filesystem;

namespace tether {
namespace {

using test::contents;
using test::Folder;
using test::run_into;

const std::string kLap = in_source("/scenarios/warehouse_lap.toml");

/// The ready lap with other settings.
Scenario lap(const std::vector<std::string>& overrides) { return load_scenario(kLap, overrides); }

/// Runs a lap, or to the end, and 5 s on.
void expect_to_follow(const std::vector<std::string>& overrides, double largest_error_m) {
  Scenario scenario = lap(overrides);
  const auto path = plan_path(scenario.get<PathSettings>());
  const SpeedProfile& profile = path->profile();
  scenario.get<RunSettings>().duration_s = std::ceil(profile.first_s() + profile.lap_s() + 5.0);
  ClosedLoop loop(scenario);
  RunObserver observer(scenario, loop.loop(), loop.bus());
  loop.run();
  EXPECT_LT(loop.sim().metrics().max_error_m(), largest_error_m);
  EXPECT_EQ(loop.sim().metrics().wall_contact_s(), 0.0);
  EXPECT_NEAR(
      observer.truth().x_ref_m,
      make_path(scenario.get<PathSettings>())->at(scenario.get<RunSettings>().duration_s).x_m,
      1e-9);
}

// The PID looks 1 s ahead: it cuts corners. Measured: 0.23, 0.23, 0.58 and 0.27 m.
TEST(PathLoop, ThePidFollowsACircle) { expect_to_follow({"path.kind=circle"}, 0.7); }
TEST(PathLoop, ThePidFollowsALineToItsEnd) { expect_to_follow({"path.kind=line"}, 0.7); }
TEST(PathLoop, ThePidFollowsARoundedRectangle) {
  expect_to_follow({"path.kind=rounded_rectangle"}, 0.7);
}
TEST(PathLoop, ThePidFollowsALapThroughTheWarehouse) {
  expect_to_follow({}, 0.7);
  expect_to_follow({"vehicle.plant=kinematic"}, 0.7);
}

TEST(PathLoop, TheOutputFolderHoldsItsWaypointsAndReproducesTheRun) {
  const Folder folder;
  run_into(folder.path / "a", lap({"run.duration_s=20"}));
  EXPECT_EQ(contents(folder.path / "a" / "path.csv"),
            contents(in_source("/scenarios/paths/warehouse_lap.csv")));
  fs::rename(folder.path / "a", folder.path / "moved");
  const std::string again = (folder.path / "moved" / "scenario.toml").string();
  run_into(folder.path / "b", load_scenario(again, {}));
  EXPECT_EQ(contents(folder.path / "moved" / "run.lcmlog"),
            contents(folder.path / "b" / "run.lcmlog"));
  // In place, too: the file is its own source, then.
  run_into(folder.path / "moved", load_scenario(again, {}));
  EXPECT_EQ(contents(folder.path / "moved" / "run.lcmlog"),
            contents(folder.path / "b" / "run.lcmlog"));
}

}  // namespace
}  // namespace tether
