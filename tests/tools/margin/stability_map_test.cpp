#include "tools/margin/stability_map.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "common/base/errors.hpp"
#include "tests/support/source_dir.hpp"

namespace tether {
namespace {

const Scenario& straight() {
  static const Scenario scenario =
      load_scenario(in_source("/scenarios/paper.toml"),
                    {"controller.law=tracking", "vehicle.plant=kinematic", "sensor.rate_hz=10",
                     "sensor.position_noise_m=0.02", "path.kind=line", "path.length_m=90",
                     "path.speed_mps=1.5", "world.half_extent_m=500"});
  return scenario;
}

const StabilityMap& map() {
  static const StabilityMap drawn = stability_map(straight(), 0.5, 4, 2);
  return drawn;
}

/// The least PRR that is stable with this delay; 2 if none is.
double edge_prr(double delay_s) {
  const auto at = std::ranges::find_if(
      map().edges, [&](const StabilityMap::Edge& edge) { return edge.delay_s >= delay_s; });
  return at == map().edges.end() ? 2.0 : at->prr;
}

TEST(StabilityMapTest, TheEdgeAsksForMoreReceptionWithMoreDelay) {
  ASSERT_GT(map().edges.size(), 30U);
  EXPECT_TRUE(std::ranges::is_sorted(map().edges, {}, &StabilityMap::Edge::delay_s));
  EXPECT_TRUE(std::ranges::is_sorted(map().edges, {}, &StabilityMap::Edge::prr));
  EXPECT_NEAR(map().edges.front().prr, 0.551, 0.002);
  EXPECT_NEAR(map().edges.back().delay_s, 0.400, 0.400 / 48.0 + 0.001);  // the step before it
}

// Near the edge the mean square is finite but large, and beyond it 60 s may be too short to leave.
TEST(StabilityMapTest, RunsWellInsideStayAndRunsWellOutsideDoNot) {
  int inside = 0, outside = 0;
  for (const StabilityMap::Point& point : map().points) {
    const double edge = edge_prr(point.delay_s);
    if (point.prr >= edge + 0.2) {
      EXPECT_LT(point.error_m, map().limit_m) << point.prr << " at " << point.delay_s << " s";
      ++inside;
    }
    if (edge <= 1.0 && point.prr <= edge - 0.3) {
      EXPECT_GT(point.error_m, map().limit_m) << point.prr << " at " << point.delay_s << " s";
      ++outside;
    }
  }
  EXPECT_GT(inside, 10);
  EXPECT_GT(outside, 5);
}

TEST(StabilityMapTest, IsDrawnWithItsScriptAndDataBesideIt) {
  const auto folder = std::filesystem::path(testing::TempDir()) / "stability_map_test";
  std::filesystem::remove_all(folder);
  draw_stability_map(folder / "map.svg", straight(), map());
  for (const char* const name : {"map.svg", "map.gp", "map-edge.csv", "map-runs.csv"}) {
    EXPECT_TRUE(std::filesystem::exists(folder / name)) << name;
  }
  EXPECT_THROW(draw_stability_map(folder / "map.bmp", straight(), map()), UsageError);
}

}  // namespace
}  // namespace tether
