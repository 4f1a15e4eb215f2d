#include "tools/view/sources/run_json.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <utility>

#include "common/fleet/fleet.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/path/reference_path.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/section.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/shape.hpp"
#include "tools/base/json.hpp"
#include "tools/view/server/playback.hpp"

namespace tether {
namespace {

using Json = nlohmann::ordered_json;

/// "vehicle.track_m" is in the object "vehicle".
void put(Json& all, const std::string& key, const ScenarioValue& value) {
  Json* at = &all;
  std::size_t begin = 0;
  for (std::size_t dot = key.find('.'); dot != std::string::npos;
       begin = dot + 1, dot = key.find('.', begin)) {
    at = &(*at)[key.substr(begin, dot - begin)];
  }
  std::visit([&](const auto& x) { (*at)[key.substr(begin)] = x; }, value);
}

Json scenario_json(const Scenario& scenario) {
  Json all = Json::object();
  for (const ScenarioKey& key : scenario.schema().keys_of(scenario)) {
    const auto value = key.get(scenario);
    if (value && !scenario.schema().left_out(scenario, key)) put(all, key.name, *value);
  }
  return all;
}

Json shape_json(const VehicleConfig& vehicle) {
  return {{"track_m", vehicle.track_m},
          {"wheel_radius_m", vehicle.wheel_radius_m},
          {"chassis_length_m", vehicle.chassis_length_m},
          {"chassis_width_m", vehicle.chassis_width_m}};
}

/// The paths as lines for drawing: each once, however many vehicles follow it; laps are the same
/// wherever they begin.
class PathLines {
 public:
  /// The number of a vehicle's.
  std::size_t number(const Scenario& member) {
    Scenario lap = member;
    lap.get<PathSettings>().phase = 0.0;
    std::string key;
    for (const ScenarioKey& one : lap.schema().keys()) {
      const auto value = one.name.starts_with("path.") ? one.get(lap) : std::nullopt;
      if (value) key += to_toml(*value) + "\n";
    }
    const auto [found, is_new] = numbers_.try_emplace(key, lines_.size());
    if (is_new) lines_.push_back(member);
    return found->second;
  }

  Json json() const {
    Json all = Json::array();
    const double most =
        std::clamp(20'000.0 / static_cast<double>(std::max<std::size_t>(lines_.size(), 1)), 100.0,
                   kMostPathPoints - 1.0);
    for (const Scenario& member : lines_) {
      const auto path = make_path(member.get<PathSettings>());
      const double duration_s = member.get<RunSettings>().duration_s;
      const double steps = std::clamp(std::ceil(duration_s / 0.1), 1.0, most);
      Json& line = all.emplace_back(Json::array());
      for (double i = 0.0; i <= steps; ++i) {
        const PathPoint at = path->at(duration_s * i / steps);
        line.push_back({at.x_m, at.y_m});
      }
    }
    return all;
  }

 private:
  std::map<std::string, std::size_t> numbers_;
  std::vector<Scenario> lines_;
};

/// Properties of each vehicle of a fleet.
void put_vehicles(Json& all, const RunDescription& run) {
  PathLines paths;
  Json vehicles = Json::array();
  for (const Scenario& member : run.members) {
    const auto& vehicle = member.get<VehicleSettings>();
    vehicles.push_back({{"name", vehicle.name},
                        {"shape", shape_json(vehicle)},
                        {"path", paths.number(member)},
                        {"scenario", Json::object()}});
  }
  const auto& fleet = run.scenario->get<FleetSettings>();
  for (const FleetSettings::Variant& variant : fleet.variants) {
    for (const int number : variant.numbers) {
      Json& own = vehicles.at(static_cast<std::size_t>(number - 1)).at("scenario");
      for (const auto& [key, value] : variant.own) put(own, key, value);
    }
  }
  all["vehicles"] = std::move(vehicles);
  all["paths"] = paths.json();
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

void RunDescription::take(const Scenario& of_the_run) {
  scenario = &of_the_run;
  if (!of_the_run.get<FleetSettings>().is_one()) members = fleet_members(of_the_run);
  vehicle = first().get<VehicleSettings>().name;
  scene = scene_setting(first());
}

std::vector<std::string> RunDescription::vehicles() const {
  std::vector<std::string> names;
  for (const Scenario& member : members) names.push_back(member.get<VehicleSettings>().name);
  if (names.empty()) names.push_back(vehicle);
  return names;
}

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
  Json all = {{"kind", run.kind},
              {"source", run.source},
              {"vehicle", run.vehicle},
              {"notes", run.notes},
              {"publishable", run.publishable},
              {"half_extent_m",
               run.scene.half_extent_m > 0.0 ? Json(run.scene.half_extent_m) : Json(nullptr)},
              {"shape", run.scene.vehicle ? shape_json(*run.scene.vehicle) : Json(nullptr)},
              {"path", path},
              {"obstacles", obstacles},
              {"moving", moving},
              {"parameters", parameters},
              {"scenario", run.scenario == nullptr ? Json(nullptr) : scenario_json(*run.scenario)}};
  if (!run.members.empty()) put_vehicles(all, run);
  return json_text(all);
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
