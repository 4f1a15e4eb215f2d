#include "netem/medium/radio_section.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>

#include "common/base/errors.hpp"
#include "netem/medium/ofdm_errors.hpp"

namespace tether {
namespace {

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

}  // namespace

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

}  // namespace tether
