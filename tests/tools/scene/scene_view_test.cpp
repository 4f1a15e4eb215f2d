#include "tools/scene/scene_view.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <tether/counters_t.hpp>
#include <tether/ground_truth_t.hpp>
#include <tether/pose_t.hpp>
#include <vector>

#include "common/vehicle/vehicle_settings.hpp"
#include "tools/scene/foxglove_schemas.hpp"

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
  return scene_setting(load_scenario(TETHER_SOURCE_DIR "/scenarios/paper.toml", {}));
}

/// What of a message's fields the schema does not know or misses, by path.
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
  const auto scenario =
      load_scenario(TETHER_SOURCE_DIR "/scenarios/paper.toml", {"run.duration_s=3000"});
  EXPECT_EQ(scene_setting(scenario).path.size(), kMostPathPoints);
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
  SceneView view(paper());
  std::vector<ViewMessage> made;
  view.on_message("SIM/TRUTH", content_of(ground_truth_t{}), 0, made);
  ASSERT_EQ(made.size(), 3U);
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
