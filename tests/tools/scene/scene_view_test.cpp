#include "tools/log/scene_view.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <tether/all_messages.hpp>
#include <vector>

#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/surroundings.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/log/foxglove_schemas.hpp"

namespace tether {
namespace {

using nlohmann::json;

template <class LcmType>
MessageContent content_of(const LcmType& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return inspect_message(bytes);
}

MessageContent pose_at(double x_m, double y_m, double yaw_rad) {
  pose_t pose{};
  pose.x_m = x_m;
  pose.y_m = y_m;
  pose.yaw_rad = yaw_rad;
  return content_of(pose);
}

SceneSetting paper() {
  return scene_setting(load_scenario(in_source("/scenarios/paper.toml"), {}));
}

/// Fields of a message that the schema does not know or misses, by path.
void compare(const json& schema, const json& value, const std::string& at,
             std::vector<std::string>& wrong) {
  if (schema.at("type") == "array") {
    for (const json& item : value) compare(schema.at("items"), item, at + "[]", wrong);
    return;
  }
  if (schema.at("type") != "object") return;
  for (const auto& [name, field] : value.items()) {
    if (!schema.at("properties").contains(name)) {
      wrong.push_back(at + "." + name);
    } else {
      compare(schema.at("properties").at(name), field, at + "." + name, wrong);
    }
  }
  if (!schema.contains("required")) return;
  for (const std::string name : schema.at("required")) {
    if (!value.contains(name)) wrong.push_back("no " + at + "." + name);
  }
}

TEST(SceneSetting, HasTheScenariosWallsVehicleAndPath) {
  const SceneSetting setting = paper();
  EXPECT_EQ(setting.half_extent_m, 22.0);
  EXPECT_EQ(setting.vehicle.value().track_m, 1.2);
  ASSERT_EQ(setting.path.size(), 621U);
  EXPECT_EQ(setting.path.front().t_s, 0.0);
  EXPECT_EQ(setting.path.back().t_s, 62.0);
}

TEST(SceneSetting, OfALongRunKeepsThePathShort) {
  const auto scenario = load_scenario(in_source("/scenarios/paper.toml"), {"run.duration_s=3000"});
  EXPECT_EQ(scene_setting(scenario).path.size(), kMostPathPoints);
}

/// A hall with one of each: a rack, a pillar, and a person who walks.
SceneSetting hall() {
  std::ifstream paper(in_source("/scenarios/paper.toml"));
  const std::string text{std::istreambuf_iterator<char>(paper), {}};
  return scene_setting(parse_scenario(text + R"(
[[world.obstacle]]
kind = "rack"
x_m = 15.0
y_m = 10.0
yaw_deg = 90.0
length_m = 4.0
height_m = 3.0
[[world.obstacle]]
kind = "cylinder"
x_m = -15.0
y_m = 10.0
radius_m = 0.5
[[world.obstacle]]
kind = "cylinder"
x_m = 15.0
y_m = -15.0
to = [[15.0, -5.0]]
)",
                                      "hall"));
}

TEST(SceneSetting, HasTheObstaclesThatStandAndTheWaysOfThoseThatMove) {
  const SceneSetting setting = hall();
  ASSERT_EQ(setting.obstacles.size(), 8U);  // the shelf, its six posts, the pillar
  EXPECT_EQ(setting.obstacles[0].length_m, 4.0);
  EXPECT_EQ(setting.obstacles.back().outline, Shape::Outline::circle);
  ASSERT_EQ(setting.moving.size(), 1U);
  EXPECT_GT(setting.moving[0].places.size(), 4U);
  EXPECT_LT(setting.moving[0].places.size(), 100U);
}

TEST(SceneSetting, WhatMovesIsWhereTheSimulatorHasIt) {
  const auto scenario = parse_scenario(
      "[run]\nduration_s = 100.0\nseed = 5\n[[world.obstacle]]\nkind = \"box\"\nx_m = 10.0\ny_m = "
      "10.0\n"
      "yaw_deg = 30.0\nto = [[10.0, -10.0], [-10.0, -10.0]]\n",
      "test");
  const SceneSetting setting = scene_setting(scenario);
  MovingObstacles simulated(scenario.get<Surroundings>(), 5);
  const double most_m = 0.05 * simulated.fastest_mps();
  for (double t_s = 0.0; t_s <= 100.0; t_s += 0.0137) {
    const Pose2 shown = setting.moving.at(0).at(t_s);
    const Pose2 real = simulated.at(t_s).at(0).pose;
    ASSERT_LE(std::hypot(shown.x_m - real.x_m, shown.y_m - real.y_m), most_m) << t_s;
    ASSERT_EQ(shown.yaw_rad, real.yaw_rad);
  }
  EXPECT_EQ(setting.moving[0].at(1e6).x_m, simulated.at(100.0).at(0).pose.x_m);
}

TEST(SceneView, ObstaclesStandInThePlaceAndThoseThatMoveHaveFramesOfTheirOwn) {
  SceneView view(hall());
  std::vector<ViewMessage> made;
  ground_truth_t truth{};
  view.on_message("SIM/TRUTH", content_of(truth), 0, made);
  ASSERT_EQ(made.size(), 4U);
  const json entities = json::parse(made[0].json)["entities"];
  ASSERT_EQ(entities.size(), 3U);
  const json& rack = entities[0]["cubes"].at(5);  // after floor and walls
  EXPECT_EQ(rack["size"]["x"], 4.0);
  EXPECT_NEAR(rack["size"]["z"], 3.0 - kShelfClearance_m, 1e-12);  // it stands on posts
  EXPECT_NEAR(rack["pose"]["position"]["z"].get<double>(), (3.0 + kShelfClearance_m) / 2, 1e-12);
  EXPECT_NEAR(rack["pose"]["orientation"]["z"].get<double>(), std::sqrt(0.5), 1e-12);
  EXPECT_EQ(entities[0]["cylinders"].size(), 1U);
  EXPECT_EQ(entities[1]["frame_id"], "moving 1");
  EXPECT_EQ(entities[1]["cylinders"].size(), 1U);
  EXPECT_EQ(json::parse(made[3].json)["child_frame_id"], "moving 1");
  EXPECT_EQ(json::parse(made[3].json)["translation"]["y"], -15.0);
  const auto moved_at = [&](std::int64_t utime) {
    truth.utime = utime;
    made.clear();
    view.on_message("SIM/TRUTH", content_of(truth), 0, made);
    return made.size() == 3;
  };
  EXPECT_FALSE(moved_at(50'000));
  EXPECT_TRUE(moved_at(100'000));
  EXPECT_TRUE(moved_at(100'000));  // for who begins to look
  EXPECT_TRUE(moved_at(20'000));   // a log that was wound back
}

scan_t small_scan() {
  scan_t scan{};
  scan.mount_x_m = 1.5;
  scan.angle_min_rad = -1.0;
  scan.angle_increment_rad = 0.5;
  scan.range_max_m = 25.0;
  scan.count = 3;
  scan.range_m = {2.5F, 0.0F, 0.125F};
  return scan;
}

TEST(SceneView, AScanIsSeenFromTheTruthElseFromTheReportedPose) {
  SceneView view;
  std::vector<ViewMessage> made;
  view.on_message("AGV/SCAN", content_of(small_scan()), 0, made);
  EXPECT_TRUE(made.empty()) << "the origin is not known";
  const auto frame_of_scan = [&] {
    made.clear();
    view.on_message("AGV/SCAN", content_of(small_scan()), 3'000'000'000, made);
    return made.empty() ? "" : json::parse(made.at(0).json)["frame_id"].get<std::string>();
  };
  view.on_message("AGV/POSE", pose_at(0, 0, 0), 0, made);
  EXPECT_EQ(frame_of_scan(), "AGV/POSE");
  localisation_t localisation{};
  view.on_message("AGV/LOCALISATION", content_of(localisation), 0, made);
  EXPECT_EQ(frame_of_scan(), "AGV/POSE") << "a localiser that searches knows no place";
  localisation.state = localisation_t::TRACKING;
  view.on_message("AGV/LOCALISATION", content_of(localisation), 0, made);
  EXPECT_EQ(frame_of_scan(), "AGV/LOCALISATION");
  view.on_message("SIM/TRUTH", content_of(ground_truth_t{}), 0, made);
  EXPECT_EQ(frame_of_scan(), "SIM/TRUTH");
  const json scan = json::parse(made.at(0).json);
  EXPECT_EQ(made.at(0).channel, "VIEW/SCAN");
  EXPECT_EQ(scan["ranges"], (json{2.5, 0.0, 0.125}));
  EXPECT_EQ(scan["start_angle"], -1.0);
  EXPECT_EQ(scan["end_angle"], 0.0);
  EXPECT_EQ(scan["pose"]["position"]["x"], 1.5);
  EXPECT_EQ(scan["timestamp"]["sec"], 3);
}

TEST(SceneView, ScansOfOtherVehiclesAndThoseThatAreNotFiniteAddNothing) {
  SceneView view;
  std::vector<ViewMessage> made;
  view.on_message("AGV/POSE", pose_at(0, 0, 0), 0, made);
  view.on_message("AGV7/POSE", pose_at(0, 0, 0), 0, made);
  view.on_message("AGV/SCAN", content_of(small_scan()), 0, made);
  made.clear();
  view.on_message("AGV7/SCAN", content_of(small_scan()), 0, made);
  scan_t broken = small_scan();
  broken.range_m[1] = std::numeric_limits<float>::infinity();
  view.on_message("AGV/SCAN", content_of(broken), 0, made);
  broken = small_scan();
  broken.angle_increment_rad = std::numeric_limits<double>::quiet_NaN();
  view.on_message("AGV/SCAN", content_of(broken), 0, made);
  EXPECT_TRUE(made.empty());
}

TEST(SceneView, WhoDrivesIsNoFurtherVehicle) {
  SceneView view;
  std::vector<ViewMessage> made;
  view.on_message("AGV/AUTONOMY", content_of(autonomy_state_t{}), 0, made);
  EXPECT_TRUE(made.empty());
}

TEST(SceneView, APoseBecomesATransformOfItsChannelsFrame) {
  SceneView view;
  std::vector<ViewMessage> made;
  view.on_message("CTRL/POSE", pose_at(1.5, -2.0, std::numbers::pi / 2.0), 2'000'000'005, made);
  ASSERT_EQ(made.size(), 2U);
  EXPECT_EQ(made[1].channel, "VIEW/FRAMES");
  const json transform = json::parse(made[1].json);
  EXPECT_EQ(transform["timestamp"], (json{{"sec", 2}, {"nsec", 5}}));
  EXPECT_EQ(transform["parent_frame_id"], "world");
  EXPECT_EQ(transform["child_frame_id"], "CTRL/POSE");
  EXPECT_EQ(transform["translation"], (json{{"x", 1.5}, {"y", -2.0}, {"z", 0}}));
  EXPECT_NEAR(transform["rotation"]["z"], std::sqrt(0.5), 1e-15);
  EXPECT_NEAR(transform["rotation"]["w"], std::sqrt(0.5), 1e-15);
}

TEST(SceneView, TheSceneComesOnceForEachFrameAndIsWholeEachTime) {
  SceneView view(paper());
  std::vector<ViewMessage> made;
  view.on_message("SIM/TRUTH", content_of(ground_truth_t{}), 0, made);
  view.on_message("CTRL/POSE", pose_at(0, 0, 0), 0, made);
  view.on_message("CTRL/POSE", pose_at(0, 0, 0), 0, made);
  std::vector<std::string> channels;
  for (const ViewMessage& message : made) channels.emplace_back(message.channel);
  EXPECT_EQ(channels, (std::vector<std::string>{"VIEW/SCENE", "VIEW/FRAMES", "VIEW/REFERENCE",
                                                "VIEW/SCENE", "VIEW/FRAMES", "VIEW/FRAMES"}));
  const json last = json::parse(made[3].json);
  ASSERT_EQ(last["entities"].size(), 3U);
  EXPECT_EQ(last["entities"][0]["lines"][0]["points"].size(), 621U);
  EXPECT_EQ(last["entities"][1]["frame_id"], "CTRL/POSE");
  EXPECT_EQ(last["entities"][2]["frame_id"], "SIM/TRUTH");
  EXPECT_EQ(last["entities"][2]["cylinders"].size(), 2U);
}

TEST(SceneView, MessagesAreAsTheirSchemasSay) {
  SceneView view(hall());
  std::vector<ViewMessage> made;
  view.on_message("SIM/TRUTH", content_of(ground_truth_t{}), 0, made);
  view.on_message("AGV/SCAN", content_of(small_scan()), 0, made);
  ASSERT_EQ(made.size(), 5U);
  for (const ViewMessage& message : made) {
    for (const FoxgloveSchema& schema : foxglove_schemas()) {
      if (schema.name != message.schema) continue;
      std::vector<std::string> wrong;
      compare(json::parse(schema.json_schema), json::parse(message.json), std::string(schema.name),
              wrong);
      EXPECT_EQ(wrong, std::vector<std::string>{});
    }
  }
}

TEST(SceneView, WithoutAScenarioAnArrowShowsWhereTheVehicleIs) {
  SceneView view;
  std::vector<ViewMessage> made;
  view.on_message("AGV/POSE", pose_at(0, 0, 0), 0, made);
  const json scene = json::parse(view.scene_update(0));
  EXPECT_EQ(scene["entities"][1]["arrows"].size(), 1U);
  EXPECT_EQ(scene["entities"][1]["cubes"].size(), 0U);
}

TEST(SceneView, PosesThatAreNoneAndOtherMessagesAddNothing) {
  SceneView view;
  std::vector<ViewMessage> made;
  view.on_message("AGV/POSE", pose_at(std::numeric_limits<double>::quiet_NaN(), 0, 0), 0, made);
  view.on_message("NET/COUNTERS", content_of(counters_t{}), 0, made);
  view.on_message("X", inspect_message({}), 0, made);
  EXPECT_TRUE(made.empty());
}

TEST(SceneView, InventedChannelsEndAtABound) {
  SceneView view;
  std::vector<ViewMessage> made;
  for (int i = 0; i < 200; ++i) {
    view.on_message("X" + std::to_string(i), pose_at(0, 0, 0), 0, made);
  }
  EXPECT_EQ(made.size(), 2 * SceneView::kMostFrames);
}

}  // namespace
}  // namespace tether
