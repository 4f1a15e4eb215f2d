#include "tools/scene/scene_shapes.hpp"

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

namespace tether {
namespace {

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

}  // namespace

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

}  // namespace tether
