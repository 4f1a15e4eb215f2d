#include "tools/view/sources/run_json.hpp"

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "common/path/reference_path.hpp"
#include "common/scenario/section.hpp"
#include "common/world/shape.hpp"
#include "tools/view/playback/playback.hpp"

namespace tether {
namespace {

using Json = nlohmann::ordered_json;

/// "vehicle.track_m" is in the object "vehicle".
Json scenario_json(const Scenario& scenario) {
  Json all = Json::object();
  for (const ScenarioKey& key : scenario.schema().keys_of(scenario)) {
    const auto value = key.get(scenario);
    if (!value || scenario.schema().left_out(scenario, key)) continue;
    Json* at = &all;
    std::size_t begin = 0;
    for (std::size_t dot = key.name.find('.'); dot != std::string::npos;
         begin = dot + 1, dot = key.name.find('.', begin)) {
      at = &(*at)[key.name.substr(begin, dot - begin)];
    }
    std::visit([&](const auto& x) { (*at)[key.name.substr(begin)] = x; }, *value);
  }
  return all;
}

Json vehicle_json(const SceneSetting& scene) {
  if (!scene.vehicle) return nullptr;
  return {{"track_m", scene.vehicle->track_m},
          {"wheel_radius_m", scene.vehicle->wheel_radius_m},
          {"chassis_length_m", scene.vehicle->chassis_length_m},
          {"chassis_width_m", scene.vehicle->chassis_width_m}};
}

/// Its corners; of a circle as many as it needs to look like one.
Json outline_json(const Shape& shape) {
  Json outline = Json::array();
  if (shape.outline == Shape::Outline::rectangle) {
    for (const Position& corner : corners(shape)) outline.push_back({corner.x_m, corner.y_m});
    return outline;
  }
  constexpr int kCorners = 24;
  for (int i = 0; i < kCorners; ++i) {
    const double angle_rad = 2.0 * std::numbers::pi * i / kCorners;
    outline.push_back({shape.pose.x_m + shape.radius_m * std::cos(angle_rad),
                       shape.pose.y_m + shape.radius_m * std::sin(angle_rad)});
  }
  return outline;
}

Json moving_json(const MovingShape& moving) {
  Shape shape = moving.shape;
  shape.pose.x_m = shape.pose.y_m = 0.0;
  Json places = Json::array();
  for (const MovingShape::Place& place : moving.places) {
    places.push_back({place.t_s, place.x_m, place.y_m});
  }
  return {{"outline", outline_json(shape)}, {"places", std::move(places)}};
}

Json parameter_json(const ParameterDescription& d) {
  Json one = {{"name", d.name}, {"kind", d.kind}};
  if (d.low) one["low"] = *d.low;
  if (d.high) one["high"] = *d.high;
  if (!d.choices.empty()) one["choices"] = d.choices;
  if (!d.allowed.empty()) one["allowed"] = d.allowed;
  one["meaning"] = d.meaning;
  one["can_be_set"] = d.can_be_set;
  return one;
}

}  // namespace

std::string run_json(const RunDescription& run) {
  Json path = Json::array();
  for (const TimedPoint& p : run.scene.path) {
    path.push_back({p.t_s, p.point.x_m, p.point.y_m, p.point.yaw_rad});
  }
  Json obstacles = Json::array(), moving = Json::array();
  for (const Shape& shape : run.scene.obstacles) obstacles.push_back(outline_json(shape));
  for (const MovingShape& one : run.scene.moving) moving.push_back(moving_json(one));
  Json parameters = Json::array();
  for (const ParameterDescription& d : run.parameters) parameters.push_back(parameter_json(d));
  const Json all = {
      {"kind", run.kind},
      {"source", run.source},
      {"vehicle", run.vehicle},
      {"notes", run.notes},
      {"publishable", run.publishable},
      {"half_extent_m",
       run.scene.half_extent_m > 0.0 ? Json(run.scene.half_extent_m) : Json(nullptr)},
      {"shape", vehicle_json(run.scene)},
      {"path", path},
      {"obstacles", obstacles},
      {"moving", moving},
      {"parameters", parameters},
      {"scenario", run.scenario == nullptr ? Json(nullptr) : scenario_json(*run.scenario)}};
  return all.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::vector<ParameterDescription> playback_descriptions(double start_s, double end_s,
                                                        bool can_jump) {
  std::vector<ParameterDescription> all(5);
  all[0].name = "playback.position_s";
  all[0].kind = "number";
  all[0].low = start_s;
  all[0].high = end_s;
  all[0].meaning = "what is shown is of this time, s";
  all[0].can_be_set = can_jump;
  all[1].name = "playback.speed";
  all[1].kind = "number";
  all[1].low = Playback::kSlowest;
  all[1].high = Playback::kFastest;
  all[1].meaning = "seconds of the run per second";
  all[2].name = "playback.playing";
  all[2].kind = "switch";
  all[2].meaning = "false: it stands still";
  all[3].name = "playback.start_s";
  all[3].kind = "number";
  all[3].meaning = "where it begins, s";
  all[3].can_be_set = false;
  all[4].name = "playback.end_s";
  all[4].kind = "number";
  all[4].meaning = "where it ends, s";
  all[4].can_be_set = false;
  return all;
}

}  // namespace tether
