#include "netem/medium/medium_section.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <set>
#include <string>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"
#include "netem/medium/medium_settings.hpp"
#include "netem/medium/ofdm_errors.hpp"
#include "netem/medium/shared_medium.hpp"

namespace tether {
namespace {

/// SNR of stations.
inline constexpr Range kSnrRange_db{-50.0, 100.0, false};

/// The keys of [medium.radio].
void radio_link_keys(KeyTable<RadioSettings> table, KeyTable<MediumSettings>& medium);

using Radio = RadioSettings;
using Clutter = IndoorFactory::Clutter;

constexpr Range kPlaces{-1e6, 1e6, false};

const std::set<std::string> kOfHalls{
    "access_points",    "clutter",          "carrier_GHz",           "power_dBm",
    "noise_figure_db",  "clutter_density",  "clutter_size_m",        "clutter_height_m",
    "station_height_m", "vehicle_height_m", "roaming_hysteresis_db", "roaming_break_ms",
    "roaming_queue"};

void hall_keys(KeyTable<Radio>& t) {
  t.rows("access_points", &Radio::access_points, kPlaces,
         "hall: [[x_m, y_m], ...], in the world's frame, all on one channel");
  t.number("roaming_hysteresis_db", &Radio::roaming_hysteresis_db, {0.0, 60.0, false},
           "hall: lead of another access point's signal at which vehicles change to it");
  t.number("roaming_break_ms", &Radio::roaming_break_ms, {0.0, 60'000.0, false},
           "hall: interruption after a change of the access point");
  t.choice<bool>("roaming_queue", &Radio::roaming_waits, {{"wait", true}, {"lost", false}},
                 "hall: handling of frames during that interruption");
  t.choice<Clutter>(
      "clutter", &Radio::clutter,
      {{"sparse_low", Clutter::sparse_low},
       {"dense_low", Clutter::dense_low},
       {"sparse_high", Clutter::sparse_high},
       {"dense_high", Clutter::dense_high}},
      "hall: clutter density, and access points within or above it: TR 38.901, InF-SL, DL, SH, DH");
  t.number("carrier_GHz", &Radio::carrier_GHz, {0.5, 100.0, false}, "hall: carrier frequency");
  t.number("power_dBm", &Radio::power_dBm, {-50.0, 60.0, false},
           "hall: transmit power of all senders, with their antennas");
  t.number("noise_figure_db", &Radio::noise_figure_db, {0.0, 60.0, false},
           "hall: noise figure of all receivers, including their implementation losses");
  t.optional_number("clutter_density", &Radio::clutter_density, {0.0, 0.99, true},
                    "hall: share of the floor that clutter covers; not set: 0.2 sparse, 0.6 dense");
  t.optional_number("clutter_size_m", &Radio::clutter_size_m, kLength,
                    "hall: size of clutter; not set: 10 sparse, 2 dense");
  t.optional_number("clutter_height_m", &Radio::clutter_height_m, kLength,
                    "hall: height of clutter; not set: 2 sparse, 6 dense");
  t.optional_number("station_height_m", &Radio::station_height_m, kLength,
                    "hall: height of access points; not set: 1.5 low, 8 high");
  t.optional_number("vehicle_height_m", &Radio::vehicle_height_m, kLength,
                    "hall: height of vehicles' antennas; not set: 1.5");
}

[[noreturn]] void refuse(const std::string& file, const std::string& what) {
  throw UsageError(fmt::format("{}: {}", file, what));
}

void check_hall(const Radio& radio, const std::string& file) {
  if (radio.access_points.empty()) {
    refuse(file,
           "medium.radio.model = \"hall\" needs medium.radio.access_points = [[x_m, y_m], …]");
  }
  for (const auto& place : radio.access_points) {
    if (place.size() == 2) continue;
    refuse(file, "medium.radio.access_points: each must be [x_m, y_m]");
  }
  const IndoorFactory hall = radio.hall();
  if (!hall.station_is_high()) return;
  if (hall.station_height_m > hall.clutter_height_m &&
      hall.clutter_height_m > hall.vehicle_height_m) {
    return;
  }
  refuse(file, fmt::format("medium.radio: with access points above the clutter heights must rise "
                           "from vehicle_height_m = {} over clutter_height_m = {} to "
                           "station_height_m = {}",
                           hall.vehicle_height_m, hall.clutter_height_m, hall.station_height_m));
}

void radio_link_keys(KeyTable<Radio> t, KeyTable<MediumSettings>& medium) {
  t.choice<Radio::Model>(
      "model", &Radio::model,
      {{"none", Radio::Model::none}, {"fixed", Radio::Model::fixed}, {"hall", Radio::Model::hall}},
      "Wi-Fi: source of noise errors: medium.error_ratio alone, the ratio snr_db, or the vehicle's "
      "position");
  t.number("snr_db", &Radio::snr_db, kSnrRange_db, "fixed: ratio of signal to noise");
  t.boolean(
      "adapt_rate", &Radio::adapt_rate,
      "choose the best rate up to medium.rate_Mbps for each attempt, instead of a constant one");
  t.number("highest_error_ratio", &Radio::highest_error_ratio, {1e-6, 1.0, false},
           "adapt_rate: maximum error ratio of a rate that is used");
  t.optional_number("capture_sinr_db", &Radio::capture_sinr_db, {0.0, 60.0, false},
                    "capture threshold: a colliding uplink frame above this ratio of signal to "
                    "noise and interference is received; not set: no capture");
  hall_keys(t);
  medium.append(t.take());
}

/// Why `key`, a part behind "medium.radio.", has no effect; "" if it has one.
std::string why_no_effect_on_radio(const MediumSettings& medium, const std::string& key) {
  const Radio& radio = medium.radio;
  if (!medium.is_wifi()) return "medium.model is \"scheduled\"";
  if (key == "model") return "";
  if (radio.model == Radio::Model::none) return "medium.radio.model is \"none\"";
  if (key == "snr_db" && radio.model != Radio::Model::fixed) {
    return "medium.radio.model is \"hall\"";
  }
  if (kOfHalls.contains(key) && radio.model != Radio::Model::hall) {
    return "medium.radio.model is \"fixed\"";
  }
  if (key.starts_with("roaming_") && radio.access_points.size() < 2) {
    return "medium.radio.access_points has less than two";
  }
  if (key == "highest_error_ratio" && !radio.adapt_rate) return "medium.radio.adapt_rate is false";
  return "";
}

/// Throws UsageError, which begins with `file`, for what does not go together.
void check_radio(const MediumSettings& medium, const std::string& file) {
  const bool has_levels = std::any_of(medium.background.begin(), medium.background.end(),
                                      [](const auto& b) { return b.snr_db.has_value(); });
  if (!medium.is_wifi() || medium.radio.model == Radio::Model::none) {
    if (!has_levels) return;
    refuse(file, fmt::format("[[medium.background]] snr_db has no effect: {}",
                             medium.is_wifi() ? "medium.radio.model is \"none\""
                                              : "medium.model is \"scheduled\""));
  }
  if (medium.he) {
    refuse(file,
           "medium.he = true does not go with medium.radio.model: error ratios are known of "
           "OFDM's rates alone");
  }
  if (std::find(kOfdmRates_Mbps.begin(), kOfdmRates_Mbps.end(), medium.rate_Mbps) ==
      kOfdmRates_Mbps.end()) {
    refuse(file, fmt::format("medium.rate_Mbps = {} must be one of {} with medium.radio.model",
                             medium.rate_Mbps, fmt::join(kOfdmRates_Mbps, ", ")));
  }
  if (medium.radio.model == Radio::Model::hall) check_hall(medium.radio, file);
}

using Medium = MediumSettings;
using Background = Medium::Background;

constexpr const char* kBackground = "medium.background";
const std::vector<std::string> kCategories{"BK", "BE", "VI", "VO"};
const Names<Background::Kind> kKinds{{"saturated", Background::Kind::saturated},
                                     {"poisson", Background::Kind::poisson},
                                     {"periodic", Background::Kind::periodic}};
constexpr std::int64_t kMostStations = 1000, kMostBytes = 60'000;
constexpr Range kRateRange_hz{1e-3, 1e4, false};

bool set_whole(std::int64_t& to, const ScenarioValue& value, std::int64_t most) {
  const auto* whole = std::get_if<std::int64_t>(&value);
  if (whole == nullptr || *whole < 1 || *whole > most) return false;
  to = *whole;
  return true;
}

bool set_preset(Background& b, const ScenarioValue& value) {
  const auto* name = std::get_if<std::string>(&value);
  const TrafficPreset* preset = name == nullptr ? nullptr : traffic_preset(*name);
  if (preset == nullptr) return false;
  b.kind = preset->kind;
  b.rate_hz = preset->rate_hz;
  b.bytes = preset->bytes;
  return true;
}

bool set_field(Background& b, const std::string& key, const ScenarioValue& value) {
  const auto* text = std::get_if<std::string>(&value);
  if (key == "stations") return set_whole(b.stations, value, kMostStations);
  if (key == "bytes") return set_whole(b.bytes, value, kMostBytes);
  if (key == "rate_hz") {
    const auto rate = number_of(value);
    if (rate) b.rate_hz = *rate;
    return rate && kRateRange_hz.contains(*rate);
  }
  if (key == "snr_db") {
    b.snr_db = number_of(value);
    return b.snr_db && kSnrRange_db.contains(*b.snr_db);
  }
  if (text == nullptr) return false;
  if (key == "way") {
    b.down = *text == "down";
    return b.down || *text == "up";
  }
  if (key == "category") {
    b.category = *text;
    return std::find(kCategories.begin(), kCategories.end(), *text) != kCategories.end();
  }
  const auto kind = std::find_if(kKinds.begin(), kKinds.end(),
                                 [text](const auto& row) { return row.first == *text; });
  if (key != "kind" || kind == kKinds.end()) return false;
  b.kind = kind->second;
  return true;
}

bool read_background(Scenario& scenario, const std::vector<TableList::Table>& tables,
                     const std::string& /*place*/) {
  std::vector<Background> all;
  for (const TableList::Table& table : tables) {
    Background& b = all.emplace_back();
    const auto preset = table.find("preset");
    if (preset != table.end() && !set_preset(b, preset->second)) return false;
    for (const auto& [key, value] : table) {
      if (key != "preset" && !set_field(b, key, value)) return false;
    }
    const bool saturated = b.kind == Background::Kind::saturated;
    if (saturated && (table.contains("rate_hz") || b.down || preset != table.end())) return false;
  }
  scenario.get<Medium>().background = std::move(all);
  return true;
}

std::string background_to_toml(const Scenario& scenario) {
  std::string text;
  for (const Background& b : scenario.get<Medium>().background) {
    const auto kind = std::find_if(kKinds.begin(), kKinds.end(),
                                   [&b](const auto& row) { return row.second == b.kind; });
    text += fmt::format("\n[[{}]]\nkind = \"{}\"\nstations = {}\nbytes = {}\n", kBackground,
                        kind->first, b.stations, b.bytes);
    text += fmt::format("category = \"{}\"\n", b.category);
    if (b.down) text += "way = \"down\"\n";
    if (b.snr_db) text += fmt::format("snr_db = {}\n", to_toml(ScenarioValue(*b.snr_db)));
    if (b.kind != Background::Kind::saturated) {
      text += fmt::format("rate_hz = {}\n", to_toml(ScenarioValue(b.rate_hz)));
    }
  }
  return text;
}

const std::set<std::string> kOfWifi{"he", "control_rate_Mbps", "category", "eifs", "lifetime_ms"};
const std::set<std::string> kOfCells{
    "preset", "request_period_ms", "offset_ms", "slot_ms", "repeat_after_ms", "serve", "keep"};

std::string why_no_effect(const Scenario& scenario, const std::string& key) {
  const std::string prefix = "medium.";
  if (!key.starts_with(prefix) || key == "medium.model") return "";
  const auto& medium = scenario.get<Medium>();
  const std::string part = key.substr(prefix.size());
  if (medium.model == Medium::Model::none) return "medium.model is \"none\"";
  const std::string radio = "radio.";
  if (part.starts_with(radio)) return why_no_effect_on_radio(medium, part.substr(radio.size()));
  if (medium.is_wifi() && kOfCells.contains(part)) return "medium.model is that of Wi-Fi";
  if (!medium.is_wifi() && kOfWifi.contains(part)) return "medium.model is \"scheduled\"";
  if (medium.model == Medium::Model::dcf && part == "category") return "medium.model is \"dcf\"";
  return "";
}

void check_frames(const Medium& medium, std::int64_t bytes, const std::string& what,
                  const std::string& file) {
  const std::size_t frames = fragment_bytes(static_cast<int>(bytes)).size();
  if (static_cast<std::int64_t>(frames) <= medium.queue) return;
  throw UsageError(fmt::format(
      "{}: medium.queue = {} is too short for {} of {} bytes: {} frames that wait together", file,
      medium.queue, what, bytes, frames));
}

void check(const Scenario& scenario, const std::string& file) {
  const auto& medium = scenario.get<Medium>();
  if (medium.others > kMostStations) {
    throw UsageError(fmt::format("{}: medium.others = {} must be a whole number from 0 to {}", file,
                                 medium.others, kMostStations));
  }
  if (medium.model == Medium::Model::none) {
    if (medium.background.empty()) return;
    throw UsageError(
        fmt::format("{}: [[medium.background]] has no effect: medium.model is \"none\"", file));
  }
  check_radio(medium, file);
  check_frames(medium, medium.up.bytes, "a pose", file);
  check_frames(medium, medium.down.bytes, "a command or plan", file);
  for (const Medium::Stream& stream : medium.more_up) {
    check_frames(medium, stream.bytes, "a message that vehicles send", file);
  }
  for (const Background& b : medium.background) {
    if (!medium.is_wifi() && b.kind == Background::Kind::saturated) {
      throw UsageError(fmt::format(
          "{}: [[medium.background]] kind = \"saturated\" needs medium.model = \"dcf\" or "
          "\"edca\"; in a cell take \"poisson\" at a high rate_hz",
          file));
    }
    check_frames(medium, b.bytes, "a packet of [[medium.background]]", file);
  }
}

/// Parameters of known cells; others than given keys.
struct Preset {
  const char* name;
  double request_period_ms, offset_ms, error_ratio;
};
// Fitted to published one-way uplink delays of open-source base stations: p50 12.4 to 16 ms and p95
// 21.6 ms of srsRAN, which waits to be asked; 3.3 to 4.3 ms and 5 ms of OpenAirInterface, which
// grants in each TDD period without being asked.
constexpr std::array<Preset, 2> kPresets{{{"srsran", 20.0, 2.5, 0.005}, {"oai", 2.5, 2.25, 0.0}}};

/// Given keys take precedence over the preset.
void complete(Scenario& scenario, const std::set<std::string>& given, const std::string&) {
  auto& medium = scenario.get<Medium>();
  for (const Preset& preset : kPresets) {
    if (preset.name != medium.preset) continue;
    if (!given.contains("medium.request_period_ms")) {
      medium.request_period_ms = preset.request_period_ms;
    }
    if (!given.contains("medium.offset_ms")) medium.offset_ms = preset.offset_ms;
    if (!given.contains("medium.error_ratio")) medium.error_ratio = preset.error_ratio;
  }
}

void radio_keys(KeyTable<Medium>& t) {
  t.number("rate_Mbps", &Medium::rate_Mbps, {0.1, 1e4, false},
           "data rate; of a cell: that of all users together");
  t.boolean("he", &Medium::he, "Wi-Fi: 802.11ax (HE SU) instead of OFDM");
  t.number("control_rate_Mbps", &Medium::control_rate_Mbps, {1.0, 54.0, false},
           "Wi-Fi: data rate of acknowledgements");
  t.one_of("category", &Medium::category, kCategories,
           "edca: access category of all traffic of vehicles");
  t.boolean("eifs", &Medium::eifs,
            "Wi-Fi: after a collision, stations wait as long as for an acknowledgement");
  t.whole_number("attempts", &Medium::attempts, 1,
                 "maximum number of attempts per frame; then it is lost");
  t.whole_number("queue", &Medium::queue, 1, "maximum number of frames that wait at a station");
  t.number("lifetime_ms", &Medium::lifetime_ms, kPositive,
           "Wi-Fi: maximum waiting time of a frame, after which it is dropped");
  t.number("error_ratio", &Medium::error_ratio, kRatio, "share of attempts lost to noise");
}

void cell_keys(KeyTable<Medium>& t) {
  std::vector<std::string> presets{"none"};
  for (const Preset& preset : kPresets) presets.emplace_back(preset.name);
  t.one_of(
      "preset", &Medium::preset, presets,
      "scheduled: preset of request_period_ms, offset_ms and error_ratio, like a base station's");
  t.number("request_period_ms", &Medium::request_period_ms, {0.01, 1000.0, false},
           "scheduled: interval between a vehicle's opportunities to request a grant");
  t.number("offset_ms", &Medium::offset_ms, {0.0, 1000.0, false},
           "scheduled: time from the request to the earliest transmission");
  t.number("slot_ms", &Medium::slot_ms, {0.01, 100.0, false},
           "scheduled: slot length; transmissions take whole slots");
  t.number("repeat_after_ms", &Medium::repeat_after_ms, {0.0, 1000.0, false},
           "scheduled: time from a failed transmission to the next attempt");
}

void serving_keys(KeyTable<Medium>& t) {
  using Serve = ScheduledRules::Serve;
  t.choice<Serve>("serve", &Medium::serve,
                  {{"round_robin", Serve::round_robin},
                   {"oldest_first", Serve::oldest_first},
                   {"most_valuable", Serve::most_valuable}},
                  "scheduled: vehicle served next: each in turn, the one with the oldest delivered "
                  "message, or the one whose newest pose or plan is farthest from its receiver's");
  t.choice<bool>("keep", &Medium::keep_newest, {{"all", false}, {"newest", true}},
                 "scheduled: waiting messages of a vehicle to keep: all, or only the newest");
}

std::vector<std::string> preset_names() {
  std::vector<std::string> names;
  for (const TrafficPreset& preset : kTrafficPresets) names.emplace_back(preset.name);
  return names;
}

std::string presets_help() {
  std::string text =
      "    preset = NAME sets kind, rate_hz and bytes as of 3GPP TS 22.104's mobile robots "
      "(unverified:\n    not read in the standard's own text); what is given beside it beats it:\n";
  for (const TrafficPreset& p : kTrafficPresets) {
    text += fmt::format("      {:<21} {}{}: {:g} Hz, {} bytes\n", p.name, p.what,
                        p.verified ? "" : " (unverified)", p.rate_hz, p.bytes);
  }
  return text;
}

TableList background_list() {
  return {.key = kBackground,
          .allowed = fmt::format("each [[{}]] may have kind = \"saturated\", \"poisson\" or "
                                 "\"periodic\", preset = \"{}\", stations = 1 … {}, bytes = 1 … "
                                 "{}, way = \"up\" or \"down\", category = \"{}\", "
                                 "rate_hz in [{}, {}] (saturated ones go up and have none, nor a "
                                 "preset), snr_db in [{}, {}], and "
                                 "nothing else",
                                 kBackground, fmt::join(preset_names(), "\" or \""), kMostStations,
                                 kMostBytes, fmt::join(kCategories, "\", \""), kRateRange_hz.low,
                                 kRateRange_hz.high, kSnrRange_db.low, kSnrRange_db.high),
          .read = read_background,
          .to_toml = background_to_toml};
}

}  // namespace

ScenarioSection medium_section() {
  KeyTable<Medium> t("medium.");
  t.choice<Medium::Model>("model", &Medium::model,
                          {{"none", Medium::Model::none},
                           {"dcf", Medium::Model::dcf},
                           {"edca", Medium::Model::edca},
                           {"scheduled", Medium::Model::scheduled}},
                          "medium that all links share: none, Wi-Fi without and with access "
                          "categories, or a cell that grants its uplink");
  t.whole_number("others", &Medium::others, 0,
                 "number of other vehicles that send poses and get commands like this one, each at "
                 "its own phase");
  radio_keys(t);
  cell_keys(t);
  serving_keys(t);
  radio_link_keys(t.within<RadioSettings>("radio.", &Medium::radio), t);
  ScenarioSection section{.defaults = Medium{}, .keys = t.take()};
  section.list = background_list();
  section.help =
      "[[medium.background]] kind = \"poisson\", stations = 1, bytes = 1400, rate_hz = 10, "
      "category = \"BE\", way = \"up\"\n    other stations of the medium, which send to the access "
      "point; kind \"saturated\" sends always,\n    \"periodic\" in equal periods; way = \"down\": "
      "which "
      "it sends to\n";
  section.help += presets_help();
  section.why_no_effect = why_no_effect;
  section.left_out = [](const Scenario& scenario, const ScenarioKey& key) {
    const auto& medium = scenario.get<Medium>();
    return (key.name == "medium.model" && medium.model == Medium::Model::none) ||
           (key.name == "medium.serve" && medium.serve == ScheduledRules::Serve::round_robin) ||
           (key.name == "medium.keep" && !medium.keep_newest) ||
           (key.name == "medium.radio.model" && medium.radio.model == RadioSettings::Model::none);
  };
  section.complete = complete;
  section.check = check;
  return section;
}

}  // namespace tether
