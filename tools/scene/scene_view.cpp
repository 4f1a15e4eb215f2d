#include "tools/scene/scene_view.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "tools/messages/message_json.hpp"
#include "tools/scene/foxglove_schemas.hpp"
#include "tools/scene/scene_shapes.hpp"

namespace tether {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

std::string time_json(std::int64_t time_ns) {
  return fmt::format(R"({{"sec":{},"nsec":{}}})", time_ns / kSecond_ns, time_ns % kSecond_ns);
}

std::string position_json(const Pose2& pose) {
  return fmt::format(R"({{"x":{},"y":{},"z":0}})", pose.x_m, pose.y_m);
}

std::string rotation_json(const Pose2& pose) {
  return fmt::format(R"({{"x":0,"y":0,"z":{},"w":{}}})", std::sin(pose.yaw_rad / 2.0),
                     std::cos(pose.yaw_rad / 2.0));
}

}  // namespace

std::optional<Pose2> pose_of(const MessageContent& message) {
  const auto x_m = message.real("x_m"), y_m = message.real("y_m"),
             yaw_rad = message.real("yaw_rad");
  if (!x_m || !y_m || !yaw_rad) return std::nullopt;
  const Pose2 pose{*x_m, *y_m, *yaw_rad};
  if (!is_usable(pose)) return std::nullopt;
  return pose;
}

std::string frame_transform_json(std::string_view frame, const Pose2& pose, std::int64_t time_ns) {
  std::string name;
  append_json_string(name, frame);
  return fmt::format(R"({{"timestamp":{},"parent_frame_id":"world","child_frame_id":{},)"
                     R"("translation":{},"rotation":{}}})",
                     time_json(time_ns), name, position_json(pose), rotation_json(pose));
}

std::string pose_in_frame_json(const Pose2& pose, std::int64_t time_ns) {
  return fmt::format(
      R"({{"timestamp":{},"frame_id":"world","pose":{{"position":{},"orientation":{}}}}})",
      time_json(time_ns), position_json(pose), rotation_json(pose));
}

void SceneView::on_message(std::string_view channel, const MessageContent& message,
                           std::int64_t time_ns, std::vector<ViewMessage>& out) {
  const auto pose = pose_of(message);
  if (!pose) return;
  if (!frames_.contains(channel)) {
    if (frames_.size() >= kMostFrames) return;
    frames_.emplace(channel);
    out.push_back({kSceneChannel, kSceneUpdate, scene_update(time_ns)});
  }
  out.push_back({kFramesChannel, kFrameTransform, frame_transform_json(channel, *pose, time_ns)});
  const auto x_m = message.real("x_ref_m"), y_m = message.real("y_ref_m");
  if (!x_m || !y_m) return;
  const Pose2 reference{*x_m, *y_m, 0.0};
  if (!is_usable(reference)) return;
  out.push_back({kReferenceChannel, kPoseInFrame, pose_in_frame_json(reference, time_ns)});
}

std::string SceneView::scene_update(std::int64_t time_ns) const {
  nlohmann::ordered_json update = {{"deletions", nlohmann::ordered_json::array()},
                                   {"entities", nlohmann::ordered_json::array()}};
  update["entities"].push_back(place_entity(setting_, time_ns));
  for (const std::string& frame : frames_) {
    update["entities"].push_back(vehicle_entity(setting_, frame, time_ns));
  }
  return update.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace tether
