#include "tools/scene/scene_view.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "common/bus/channel_names.hpp"
#include "tools/base/json.hpp"
#include "tools/messages/message_json.hpp"
#include "tools/scene/foxglove_schemas.hpp"
#include "tools/scene/scene_shapes.hpp"

namespace tether {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
/// Period at which moving obstacles are shown.
constexpr std::int64_t kMovingPeriod_us = 100'000;
/// Messages may say any time.
constexpr std::int64_t kLatest_us = INT64_MAX / 4;

}  // namespace

std::string time_json(std::int64_t time_ns) {
  return fmt::format(R"({{"sec":{},"nsec":{}}})", time_ns / kSecond_ns, time_ns % kSecond_ns);
}

namespace {

/// A localiser that searches; and who drives, who has its place from elsewhere.
bool says_no_place(const MessageContent& message) {
  const std::string& type = message.type->name;
  return type == "autonomy_state_t" || (type == "localisation_t" && message.integer("state") == 0);
}

std::string position_json(const Pose2& pose) {
  return fmt::format(R"({{"x":{},"y":{},"z":0}})", pose.x_m, pose.y_m);
}

std::string rotation_json(const Pose2& pose) {
  return fmt::format(R"({{"x":0,"y":0,"z":{},"w":{}}})", std::sin(pose.yaw_rad / 2.0),
                     std::cos(pose.yaw_rad / 2.0));
}

}  // namespace

std::string pose_json(const Pose2& pose) {
  return fmt::format(R"({{"position":{},"orientation":{}}})", position_json(pose),
                     rotation_json(pose));
}

std::string moving_frame(std::size_t number) { return fmt::format("moving {}", number + 1); }

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
  return fmt::format(R"({{"timestamp":{},"frame_id":"world","pose":{}}})", time_json(time_ns),
                     pose_json(pose));
}

void SceneView::on_message(std::string_view channel, const MessageContent& message,
                           std::int64_t time_ns, std::vector<ViewMessage>& out) {
  if (const auto scan = laser_scan_of(message)) {
    add_scan(channel, *scan, time_ns, out);
    return;
  }
  const auto pose = pose_of(message);
  if (!pose || says_no_place(message)) return;
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
  add_moving(std::clamp(message.integer("utime").value_or(0), -kLatest_us, kLatest_us), time_ns,
             out);
}

void SceneView::add_moving(std::int64_t utime, std::int64_t time_ns,
                           std::vector<ViewMessage>& out) {
  const bool is_too_soon = utime > moved_us_ && utime - moved_us_ < kMovingPeriod_us;
  if (is_too_soon) return;
  moved_us_ = utime;
  const double t_s = static_cast<double>(utime) / 1e6;
  for (std::size_t i = 0; i < setting_.moving.size(); ++i) {
    out.push_back({kFramesChannel, kFrameTransform,
                   frame_transform_json(moving_frame(i), setting_.moving[i].at(t_s), time_ns)});
  }
}

/// Adds a scan as seen from the vehicle's true pose, if that is known; else from its reported pose.
void SceneView::add_scan(std::string_view channel, const LaserScan& scan, std::int64_t time_ns,
                         std::vector<ViewMessage>& out) {
  if (scans_.empty()) scans_ = channel;
  if (channel != scans_) return;
  const std::string side(channel.substr(0, channel.find('/')));
  for (const std::string& frame :
       {ChannelNames(side).truth, side + "/LOCALISATION", side + "/POSE"}) {
    if (!frames_.contains(frame)) continue;
    out.push_back({kScanChannel, kLaserScan, laser_scan_json(scan, frame, time_ns)});
    return;
  }
}

std::string SceneView::scene_update(std::int64_t time_ns) const {
  nlohmann::ordered_json update = {{"deletions", nlohmann::ordered_json::array()},
                                   {"entities", nlohmann::ordered_json::array()}};
  update["entities"].push_back(place_entity(setting_, time_ns));
  for (std::size_t i = 0; i < setting_.moving.size(); ++i) {
    update["entities"].push_back(moving_entity(setting_.moving[i], moving_frame(i), time_ns));
  }
  for (const std::string& frame : frames_) {
    update["entities"].push_back(vehicle_entity(setting_, frame, time_ns));
  }
  return json_text(update);
}

}  // namespace tether
