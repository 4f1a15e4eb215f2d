#include "tools/log/scene_view.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <nlohmann/json_fwd.hpp>
#include <numbers>
#include <string>

#include "common/node/channel_names.hpp"
#include "tools/base/json.hpp"
#include "tools/log/foxglove_schemas.hpp"
#include "tools/log/scene_setting.hpp"
#include "tools/messages/message_json.hpp"

namespace tether {
namespace {

// Entities of a foxglove.SceneUpdate; each is complete, with all that its schema requires.

/// Floor, walls, obstacles that stand, and path, as far as they are known, in frame "world".
nlohmann::ordered_json place_entity(const SceneSetting& setting, std::int64_t time_ns);

/// An obstacle that moves, fixed to a frame of its own at its centre.
nlohmann::ordered_json moving_entity(const MovingShape& moving, const std::string& frame,
                                     std::int64_t time_ns);

/// The vehicle, or an arrow where its shape is not known, fixed to a frame at its axle's midpoint
/// on the floor. Channels of the simulator (SIM/…) are the truth and get a solid body with wheels,
/// all others, beliefs or measurements, a transparent one: orange for controllers
/// (CTRL…), green for drives (CAN…), grey for the rest.
nlohmann::ordered_json vehicle_entity(const SceneSetting& setting, const std::string& frame,
                                      std::int64_t time_ns);

using Json = nlohmann::ordered_json;

Json vector3(double x, double y, double z) { return {{"x", x}, {"y", y}, {"z", z}}; }
Json color(double r, double g, double b, double a) {
  return {{"r", r}, {"g", g}, {"b", b}, {"a", a}};
}
Json upright() { return {{"x", 0.0}, {"y", 0.0}, {"z", 0.0}, {"w", 1.0}}; }
Json pose(const Json& position, const Json& orientation) {
  return {{"position", position}, {"orientation", orientation}};
}

Json box(const Json& centre, const Json& size, const Json& paint) {
  return {{"pose", pose(centre, upright())}, {"size", size}, {"color", paint}};
}

/// On its rim, axis to the left.
Json wheel(double y_m, double radius_m, double width_m, const Json& paint) {
  constexpr double kHalf = std::numbers::sqrt2 / 2.0;  // a quarter turn about x
  return {{"pose",
           pose(vector3(0.0, y_m, radius_m), {{"x", kHalf}, {"y", 0.0}, {"z", 0.0}, {"w", kHalf}})},
          {"size", vector3(2.0 * radius_m, 2.0 * radius_m, width_m)},
          {"bottom_scale", 1.0},
          {"top_scale", 1.0},
          {"color", paint}};
}

Json arrow(const Json& paint) {
  return {{"pose", pose(vector3(0.0, 0.0, 0.05), upright())},
          {"shaft_length", 0.7},
          {"shaft_diameter", 0.1},
          {"head_length", 0.3},
          {"head_diameter", 0.25},
          {"color", paint}};
}

Json path_line(const std::vector<TimedPoint>& path) {
  Json points = Json::array();
  for (const TimedPoint& p : path) points.push_back(vector3(p.point.x_m, p.point.y_m, 0.0));
  return {{"type", 0},
          {"pose", pose(vector3(0.0, 0.0, 0.01), upright())},
          {"thickness", 0.06},
          {"scale_invariant", false},
          {"points", points},
          {"color", color(0.11, 0.62, 0.29, 1.0)},
          {"colors", Json::array()},
          {"indices", Json::array()}};
}

Json entity(const std::string& frame, const std::string& id, bool frame_locked,
            std::int64_t time_ns) {
  Json made = {{"timestamp", {{"sec", time_ns / 1'000'000'000}, {"nsec", time_ns % 1'000'000'000}}},
               {"frame_id", frame},
               {"id", id},
               {"lifetime", {{"sec", 0}, {"nsec", 0}}},
               {"frame_locked", frame_locked}};
  for (const char* shapes : {"metadata", "arrows", "cubes", "spheres", "cylinders", "lines",
                             "triangles", "texts", "models"}) {
    made[shapes] = Json::array();
  }
  return made;
}

Json paint_of(const std::string& channel) {
  if (channel.starts_with("SIM")) return color(0.12, 0.37, 0.75, 1.0);
  if (channel.starts_with("CTRL")) return color(0.95, 0.55, 0.1, 0.35);
  if (channel.starts_with("CAN")) return color(0.2, 0.7, 0.3, 0.35);
  return color(0.6, 0.6, 0.6, 0.35);
}

void add_walls(Json& cubes, double half_m) {
  constexpr double kThick_m = 0.2, kHigh_m = 0.6;
  const Json paint = color(0.35, 0.35, 0.35, 0.6);
  const double at_m = half_m + kThick_m / 2.0, long_m = 2.0 * (half_m + kThick_m);
  for (const double side : {-1.0, 1.0}) {
    cubes.push_back(
        box(vector3(side * at_m, 0.0, kHigh_m / 2.0), vector3(kThick_m, long_m, kHigh_m), paint));
    cubes.push_back(
        box(vector3(0.0, side * at_m, kHigh_m / 2.0), vector3(long_m, kThick_m, kHigh_m), paint));
  }
}

Json turned(double yaw_rad) {
  return {{"x", 0.0}, {"y", 0.0}, {"z", std::sin(yaw_rad / 2.0)}, {"w", std::cos(yaw_rad / 2.0)}};
}

/// With its centre above `centre`.
void add_obstacle(Json& entity, const Shape& shape, const Pose2& centre, const Json& paint) {
  const double high_m = shape.height_m - shape.clearance_m;
  const Json at = pose(vector3(centre.x_m, centre.y_m, shape.clearance_m + high_m / 2.0),
                       turned(centre.yaw_rad));
  if (shape.outline == Shape::Outline::rectangle) {
    entity["cubes"].push_back(
        {{"pose", at}, {"size", vector3(shape.length_m, shape.width_m, high_m)}, {"color", paint}});
    return;
  }
  entity["cylinders"].push_back(
      {{"pose", at},
       {"size", vector3(2.0 * shape.radius_m, 2.0 * shape.radius_m, high_m)},
       {"bottom_scale", 1.0},
       {"top_scale", 1.0},
       {"color", paint}});
}

Json place_entity(const SceneSetting& setting, std::int64_t time_ns) {
  Json place = entity("world", "place", false, time_ns);
  if (const double half_m = setting.half_extent_m; half_m > 0.0) {
    place["cubes"].push_back(box(vector3(0.0, 0.0, -0.05), vector3(2.0 * half_m, 2.0 * half_m, 0.1),
                                 color(0.85, 0.85, 0.85, 0.4)));
    add_walls(place["cubes"], half_m);
  }
  for (const Shape& shape : setting.obstacles) {
    add_obstacle(place, shape, shape.pose, color(0.55, 0.5, 0.42, 0.8));
  }
  if (!setting.path.empty()) place["lines"].push_back(path_line(setting.path));
  return place;
}

Json moving_entity(const MovingShape& moving, const std::string& frame, std::int64_t time_ns) {
  Json made = entity(frame, frame, true, time_ns);
  add_obstacle(made, moving.shape, {}, color(0.84, 0.37, 0.0, 0.9));
  return made;
}

Json vehicle_entity(const SceneSetting& setting, const std::string& frame, std::int64_t time_ns) {
  Json vehicle = entity(frame, frame, true, time_ns);
  const Json paint = paint_of(frame);
  if (!setting.vehicle) {
    vehicle["arrows"].push_back(arrow(paint));
    return vehicle;
  }
  const VehicleConfig& v = *setting.vehicle;
  vehicle["cubes"].push_back(box(vector3(-v.axle_x_m, 0.0, v.wheel_radius_m + v.chassis_z_m),
                                 vector3(v.chassis_length_m, v.chassis_width_m, v.chassis_height_m),
                                 paint));
  if (!frame.starts_with("SIM")) return vehicle;
  const Json dark = color(0.15, 0.15, 0.15, 1.0);
  for (const double side : {-0.5, 0.5}) {
    vehicle["cylinders"].push_back(
        wheel(side * v.track_m, v.wheel_radius_m, v.wheel_width_m, dark));
  }
  const double ball_m = 2.0 * v.caster_radius_m;
  Json ball = box(vector3(v.caster_x_m - v.axle_x_m, 0.0, v.caster_radius_m),
                  vector3(ball_m, ball_m, ball_m), dark);
  vehicle["spheres"].push_back(std::move(ball));
  return vehicle;
}

constexpr std::int64_t kSecond_ns = 1'000'000'000;
/// Period at which moving obstacles are shown.
constexpr std::int64_t kMovingPeriod_us = 100'000;
/// Messages may say any time.
constexpr std::int64_t kMostShown_us = INT64_MAX / 4;

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
  add_moving(std::clamp(message.integer("utime").value_or(0), -kMostShown_us, kMostShown_us),
             time_ns, out);
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
