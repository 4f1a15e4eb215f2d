#include <fmt/format.h>

#include <cmath>

#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "common/fleet/own_keys.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/key_table.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/shape.hpp"

namespace tether {
namespace {

using Fleet = FleetSettings;

constexpr Range kOffset_m{-1e3, 1e3, false};

std::vector<ScenarioKey> keys() {
  KeyTable<Fleet> t("fleet.");
  t.whole_number(
      "count", &Fleet::count, 1,
      "number of vehicles like this one, at most 1000; from 2 on they are called AGV1, AGV2 ...");
  t.choice<Fleet::Phases>("phases", &Fleet::phases,
                          {{"none", Fleet::Phases::none},
                           {"even", Fleet::Phases::even},
                           {"random", Fleet::Phases::random}},
                          "phases of the vehicles on the lap of a closed path");
  t.number("offset_x_m", &Fleet::offset_x_m, kOffset_m,
           "offset between the paths of neighbouring vehicles in a row");
  t.number("offset_y_m", &Fleet::offset_y_m, kOffset_m, "offset between rows of paths");
  t.whole_number("columns", &Fleet::columns, 0, "vehicles per row; 0: all in one row");
  t.choice<Fleet::Ticks>("ticks", &Fleet::ticks,
                         {{"together", Fleet::Ticks::together}, {"spread", Fleet::Ticks::spread}},
                         "phases of the vehicles' sensors and timers: all equal, or random");
  return t.take();
}

void check_start(const Scenario& scenario, const std::string& file) {
  const auto& vehicle = scenario.get<VehicleSettings>();
  const Pose2 start = start_on(scenario.get<PathSettings>(), vehicle);
  constexpr double kSame_m = 1e-6;
  if (std::hypot(start.x_m - vehicle.start_x_m, start.y_m - vehicle.start_y_m) < kSame_m) return;
  throw UsageError(
      fmt::format("{}: with fleet.count = {} each vehicle starts where its path begins: leave out "
                  "vehicle.start_x_m and vehicle.start_y_m",
                  file, scenario.get<Fleet>().count));
}

double gap_between(const Scenario& a, const Scenario& b) {
  const auto shapes = [](const Scenario& one) {
    const auto& v = one.get<VehicleSettings>();
    return footprint(v, {v.start_x_m, v.start_y_m, v.start_yaw_rad});
  };
  return gap_m(shapes(a), shapes(b));
}

void check_members(const std::vector<Scenario>& members, const std::string& file) {
  const auto name = [&](std::size_t i) { return members[i].get<VehicleSettings>().name; };
  for (std::size_t i = 0; i < members.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (gap_between(members[i], members[j]) > 0.0) continue;
      throw UsageError(fmt::format(
          "{}: fleet.count = {}: {} would start where {} stands. fleet.offset_x_m, offset_y_m and "
          "columns put their paths side by side, fleet.phases spreads them on a closed one",
          file, members.size(), name(i), name(j)));
    }
    for (const ScenarioSection& section : members[i].schema().sections()) {
      if (section.check) section.check(members[i], fmt::format("{}: {}", file, name(i)));
    }
  }
}

/// Checks also each of the vehicles.
void check(const Scenario& scenario, const std::string& file) {
  const Fleet& fleet = scenario.get<Fleet>();
  if (fleet.is_one()) return;
  if (fleet.count > kMostVehicles) {
    throw UsageError(fmt::format("{}: fleet.count = {}: must be a whole number from 1 to {}", file,
                                 fleet.count, kMostVehicles));
  }
  if (scenario.get<VehicleSettings>().drivetrain == VehicleSettings::Drivetrain::can) {
    throw UsageError(fmt::format(
        "{}: fleet.count = {} needs vehicle.drivetrain = \"direct\": a CAN bus is one vehicle's",
        file, fleet.count));
  }
  check_start(scenario, file);
  for (const Fleet::Variant& variant : fleet.variants) {
    check_start(*variant.scenario,
                fmt::format("{}: fleet.vehicle.{}", file, numbers_text(variant.numbers)));
  }
  try {
    check_members(fleet_members(scenario), file);
  } catch (const UsageError& error) {
    const std::string text = error.what();
    throw UsageError(text.starts_with(file) ? text : fmt::format("{}: fleet: {}", file, text));
  }
}

}  // namespace

ScenarioSection fleet_section() {
  ScenarioSection section{.defaults = Fleet{}, .keys = keys()};
  section.left_out = [](const Scenario& scenario, const ScenarioKey& key) {
    return key.name == "fleet.count" && scenario.get<Fleet>().is_one();
  };
  for (const ScenarioKey& key : section.keys) {
    if (key.name == "fleet.count") continue;
    section.switched.push_back({key.name, {"fleet.count"}, std::int64_t{1}});
  }
  section.named = own_tables();
  section.stands_for = own_keys_meant_by;
  section.vary = make_variants;
  section.help =
      "fleet.vehicle.NUMBERS.*\n    different settings of some vehicles of a fleet: NUMBERS is 3, "
      "3-5 or 1,4-6, followed by\n    keys of vehicle, sensor, path, controller, actuator, "
      "channel.uplink, "
      "channel.downlink,\n    lidar, localiser and autonomy\n";
  section.check = check;
  return section;
}

}  // namespace tether
