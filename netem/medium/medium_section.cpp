#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <set>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"
#include "netem/medium/medium_settings.hpp"
#include "netem/medium/radio_section.hpp"
#include "netem/medium/shared_medium.hpp"
#include "netem/medium/traffic_presets.hpp"

namespace tether {
namespace {

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
