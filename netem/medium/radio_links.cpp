#include "netem/medium/radio_links.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tether {
namespace {

constexpr double kThermal_dBm_Hz = -174.0, kBandwidth_Hz = 20e6;
constexpr double kStep_m = 0.1;

}  // namespace

IndoorFactory RadioSettings::hall() const {
  IndoorFactory hall = IndoorFactory::of(clutter, carrier_GHz);
  hall.clutter_density = clutter_density.value_or(hall.clutter_density);
  hall.clutter_size_m = clutter_size_m.value_or(hall.clutter_size_m);
  hall.clutter_height_m = clutter_height_m.value_or(hall.clutter_height_m);
  hall.station_height_m = station_height_m.value_or(hall.station_height_m);
  hall.vehicle_height_m = vehicle_height_m.value_or(hall.vehicle_height_m);
  return hall;
}

RadioLinks::RadioLinks(const RadioSettings& settings, std::uint64_t seed) : settings_(settings) {
  if (!wants_position()) return;
  for (const auto& place : settings.access_points) {
    RandomEngine random = random_stream(
        seed, fmt::format("medium/access point/{},{}/radio", place.at(0), place.at(1)));
    maps_.emplace_back(settings.hall(), place.at(0), place.at(1), random);
  }
}

std::size_t RadioLinks::add() {
  if (!wants_position()) return add(settings_.snr_db);
  Station& station = stations_.emplace_back();
  listen(station);
  station.access_point = best(station);
  return stations_.size() - 1;
}

std::size_t RadioLinks::add(double snr_db) {
  stations_.push_back({.fixed_db = snr_db});
  return stations_.size() - 1;
}

void RadioLinks::move(std::size_t station, double x_m, double y_m) {
  Station& s = stations_[station];
  if (s.fixed_db || std::hypot(x_m - s.x_m, y_m - s.y_m) < kStep_m) return;
  s.x_m = x_m;
  s.y_m = y_m;
  listen(s);
}

bool RadioLinks::choose(std::size_t station) {
  Station& s = stations_[station];
  if (s.fixed_db) return false;
  const bool is_first = !std::exchange(s.has_chosen, true);
  const std::size_t other = best(s);
  const double better_db = s.snr_db[other] - s.snr_db[s.access_point];
  if (!is_first && better_db <= settings_.roaming_hysteresis_db) return false;
  return std::exchange(s.access_point, other) != other && !is_first;
}

double RadioLinks::snr_db(std::size_t station, std::size_t access_point) const {
  const Station& s = stations_[station];
  return s.fixed_db ? *s.fixed_db : s.snr_db[access_point];
}

void RadioLinks::listen(Station& s) const {
  const double noise_dBm =
      kThermal_dBm_Hz + 10.0 * std::log10(kBandwidth_Hz) + settings_.noise_figure_db;
  s.snr_db.clear();
  for (const IndoorFactoryMap& map : maps_) {
    s.snr_db.push_back(settings_.power_dBm - map.path_loss_db(s.x_m, s.y_m) - noise_dBm);
  }
}

std::size_t RadioLinks::best(const Station& s) {
  return static_cast<std::size_t>(std::max_element(s.snr_db.begin(), s.snr_db.end()) -
                                  s.snr_db.begin());
}

}  // namespace tether
