#include "onboard/localiser/localiser_section.hpp"

#include <string>

#include "common/scenario/key_table.hpp"
#include "common/world/onboard_settings.hpp"

namespace tether {
namespace {

using Settings = LocaliserSettings;
using Place = Settings::Place;

constexpr char kPlace[] = "localiser.place";

bool left_out(const Scenario& scenario, const ScenarioKey& key) {
  const Place place = scenario.get<Settings>().place;
  if (key.name == kPlace) return place == Place::none;
  const bool of_parts =
      key.name == "localiser.scan_patience_ms" || key.name == "localiser.part_bytes";
  return of_parts && place != Place::edge;
}

void add_map(KeyTable<Settings>& t) {
  t.number("resolution_m", &Settings::resolution_m, {0.005, 1.0, false}, "cell size of its map");
  t.number("scan_height_m", &Settings::scan_height_m, {0.0, 10.0, false},
           "height of the scan plane above the floor: the map shows what is at that height");
}

void add_matching(KeyTable<Settings>& t) {
  t.number("range_noise_m", &Settings::range_noise_m, {1e-3, 1.0, false},
           "standard deviation of a beam's range");
  t.number("odometry_noise_m", &Settings::odometry_noise_m, {0.0, 1.0, false},
           "standard deviation of a wheel's travel after 1 m; it grows with the square root of the "
           "travel");
  t.number("max_distance_m", &Settings::max_distance_m, {0.05, 5.0, false},
           "maximum distance from the map of a beam's end; others are ignored");
  t.whole_number("max_beams", &Settings::max_beams, Settings::kLeastBeams,
                 "maximum number of beams of a scan that are matched, evenly chosen");
  t.whole_number("particles", &Settings::particles, 72,
                 "number of new particles per scan while it searches");
}

}  // namespace

ScenarioSection localiser_section() {
  KeyTable<Settings> t("localiser.");
  t.choice<Place>("place", &Settings::place,
                  {{"none", Place::none}, {"vehicle", Place::vehicle}, {"edge", Place::edge}},
                  "source of poses: [sensor], a localiser on the vehicle, or one on the "
                  "controller's side, which receives scans through the network");
  t.boolean("knows_start", &Settings::knows_start,
            "the localiser knows the start pose; false: it searches for it");
  add_map(t);
  add_matching(t);
  t.number("scan_patience_ms", &Settings::scan_patience_ms, {0.0, 1e4, false},
           "place = \"edge\": time to wait for missing parts after a scan's end");
  t.number("part_bytes", &Settings::part_bytes, {300.0, 60000.0, false},
           "place = \"edge\": maximum size of a part of a scan");
  ScenarioSection section{.defaults = Settings{}, .keys = t.take()};
  for (const ScenarioKey& key : section.keys) {
    if (key.name != kPlace) section.switched.push_back({key.name, {kPlace}, std::string("none")});
  }
  section.left_out = left_out;
  return section;
}

}  // namespace tether
