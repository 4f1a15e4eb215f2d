#include "netem/medium/wifi_stations.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <set>
#include <utility>

#include "netem/medium/ofdm_errors.hpp"
#include "netem/medium/shared_medium.hpp"

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

Roaming::Frames Roaming::leave(Instant now, std::size_t vehicle, const Frames& queued) {
  Vehicle& v = vehicles_[vehicle];
  ++counters_.changes;
  assert(!v.until);
  ++away_;
  v.until = now + rules_.away;
  Frames lost;
  for (const FrameQueue::Waiting& waiting : queued) {
    if (!hold(waiting.since, vehicle, waiting.frame)) lost.push_back(waiting);
  }
  return lost;
}

bool Roaming::hold(Instant since, std::size_t vehicle, const Frame& frame) {
  Frames& held = vehicles_[vehicle].held;
  const auto same_way = std::count_if(held.begin(), held.end(), [&frame](const auto& other) {
    return other.frame.down == frame.down;
  });
  if (!rules_.waits || static_cast<std::size_t>(same_way) >= rules_.limits.frames) {
    ++counters_.lost;
    return false;
  }
  ++counters_.held;
  held.push_back({frame, since});
  return true;
}

Instant Roaming::next_return() const {
  Instant next = Instant::max();
  if (away_ == 0) return next;
  for (const Vehicle& v : vehicles_) next = std::min(next, v.until.value_or(next));
  return next;
}

std::optional<Roaming::Return> Roaming::come_back(Instant now) {
  const Instant at = next_return();
  if (away_ == 0 || at > now) return std::nullopt;
  const auto first = std::find_if(vehicles_.begin(), vehicles_.end(),
                                  [at](const Vehicle& v) { return v.until == at; });
  Return back{at, static_cast<std::size_t>(first - vehicles_.begin()), {}, {}};
  for (const FrameQueue::Waiting& waiting : std::exchange(first->held, {})) {
    const bool expired = at - waiting.since > rules_.limits.lifetime;
    if (expired) ++counters_.lost;
    (expired ? back.expired : back.frames).push_back(waiting);
  }
  first->until.reset();
  --away_;
  return back;
}

namespace {

constexpr Duration kSlot = std::chrono::microseconds{9};  ///< 802.11-2016, table 17-21, OFDM
/// Stations of the background come after any number of vehicles.
constexpr int kFirstBackground = 1'000'000;

/// 802.11-2016, table 9-137; cw, aifsn.
AccessParameters parameters_of(const std::string& category) {
  static const std::array<std::pair<const char*, AccessParameters>, 4> rows{
      {{"BK", {15, 1023, 7}}, {"BE", {15, 1023, 3}}, {"VI", {7, 15, 2}}, {"VO", {3, 7, 2}}}};
  const auto* found = std::find_if(rows.begin(), rows.end(),
                                   [&category](const auto& row) { return category == row.first; });
  return found->second;
}

ContentionRules rules_of(const MediumSettings& settings) {
  using Countdown = ContentionRules::Countdown;
  return {.slot = kSlot,
          .sifs = WifiPhy{}.sifs,
          .countdown = settings.model == MediumSettings::Model::dcf ? Countdown::idle_slots
                                                                    : Countdown::slot_boundaries};
}

/// Rate of acknowledgements: the highest mandatory rate that is neither above that of the data nor
/// above the one that is set (802.11-2016, 10.7.6.5.2).
double control_rate_mbps(double set_Mbps, double data_Mbps) {
  for (const double rate_Mbps : {24.0, 12.0}) {
    if (rate_Mbps <= std::min(set_Mbps, data_Mbps)) return rate_Mbps;
  }
  return std::min(set_Mbps, 6.0);
}

}  // namespace

WifiPhy phy_of(const MediumSettings& settings) {
  return {.format = settings.he ? WifiPhy::Format::he_su : WifiPhy::Format::ofdm,
          .data_rate_Mbps = settings.rate_Mbps,
          .control_rate_Mbps = settings.control_rate_Mbps};
}

WifiStations::WifiStations(const MediumSettings& settings, std::uint64_t seed,
                           Contention::Ended ended)
    : settings_(settings),
      seed_(seed),
      phy_(phy_of(settings)),
      ended_(std::move(ended)),
      contention_(rules_of(settings), seed,
                  [this](const FrameEnd& end) {
                    if (end.id != BackgroundTraffic::kId) ended_(end);
                  }),
      background_(settings, seed),
      links_(settings.radio, seed),
      roaming_({.away = from_seconds(settings.radio.roaming_break_ms * 1e-3),
                .waits = settings.radio.roaming_waits,
                .limits = limits()}) {
  add_access_points();
  add_background();
  if (settings.radio.model != RadioSettings::Model::none) {
    contention_.set_renew([this](Frame& frame) { renew(frame); });
    if (settings.radio.capture_sinr_db) {
      contention_.set_capture([this](std::span<const Frame> frames, std::size_t which) {
        return errors_among(frames, which);
      });
    }
  }
}

void WifiStations::add_background() {
  std::size_t down = 0;
  for (std::size_t i = 0; i < background_.size(); ++i) {
    const MediumSettings::Background& kind = background_.of(i);
    std::optional<double> snr_db = kind.snr_db;
    if (settings_.radio.model == RadioSettings::Model::fixed && !snr_db) {
      snr_db = settings_.radio.snr_db;
    }
    background_stations_.push_back(snr_db ? static_cast<int>(links_.add(*snr_db))
                                          : Frame::kAnybody);
    if (kind.down) {
      const bool is_dcf = settings_.model == MediumSettings::Model::dcf;
      background_contenders_.push_back(access_points_[down++ % access_points_.size()].at(
          is_dcf ? settings_.category : kind.category));
      continue;
    }
    const std::size_t contender =
        contention_.add(kFirstBackground + static_cast<int>(i), access_of(kind.category), limits(),
                        background_.name(i) + "/backoff");
    background_contenders_.push_back(contender);
    if (kind.kind != MediumSettings::Background::Kind::saturated) continue;
    const auto sizes = fragment_bytes(static_cast<int>(kind.bytes));
    contention_.saturate(
        kStart, contender,
        frame(sizes.front() + kWifiOverheadBytes, background_stations_.back(), false));
  }
}

void WifiStations::add_access_points() {
  const auto& radio = settings_.radio;
  const std::size_t all =
      radio.model == RadioSettings::Model::hall ? radio.access_points.size() : 1;
  for (std::size_t number = 0; number < all; ++number) add_access_point(number);
}

/// Its queues, most urgent first.
void WifiStations::add_access_point(std::size_t number) {
  std::set<std::string> categories{settings_.category};
  if (settings_.model == MediumSettings::Model::edca) {
    for (const MediumSettings::Background& kind : settings_.background) {
      if (kind.down) categories.insert(kind.category);
    }
  }
  const std::string name =
      number == 0 ? "medium/access point/" : fmt::format("medium/access point {}/", number + 1);
  Queues& queues = access_points_.emplace_back();
  for (const std::string category : {"VO", "VI", "BE", "BK"}) {
    if (!categories.contains(category)) continue;
    const bool is_vehicles = category == settings_.category;
    queues[category] =
        contention_.add(-static_cast<int>(number), access_of(category), limits(),
                        fmt::format("{}{}backoff", name, is_vehicles ? "" : category + "/"));
  }
}

std::size_t WifiStations::add_vehicle(const std::string& name) {
  const auto number = static_cast<int>(vehicles_.size()) + 1;
  RandomEngine noise = random_stream(seed_, name + "/medium/noise");
  vehicles_.push_back(
      {contention_.add(number, access_of(settings_.category), limits(), name + "/medium/backoff"),
       static_cast<int>(links_.add()),
       {noise(), noise()}});
  roaming_.add_vehicle();
  return vehicles_.size() - 1;
}

AccessParameters WifiStations::access_of(const std::string& category) const {
  AccessParameters access =
      settings_.model == MediumSettings::Model::dcf ? AccessParameters{} : parameters_of(category);
  access.attempts = settings_.attempts;
  return access;
}

QueueLimits WifiStations::limits() const {
  return {.frames = static_cast<std::size_t>(settings_.queue),
          .lifetime = from_seconds(settings_.lifetime_ms * 1e-3)};
}

Frame WifiStations::frame(int bytes, int station, bool down) const {
  Frame frame = unicast_frame(phy_, bytes, settings_.eifs);
  frame.error_ratio = settings_.error_ratio;
  frame.station = station;
  frame.down = down;
  frame.bytes = bytes;
  frame.rate_Mbps = settings_.rate_Mbps;
  return frame;
}

/// Rate, time and errors as they are between the frame's station and its access point.
void WifiStations::renew(Frame& f) const {
  if (f.station == Frame::kAnybody) return;
  const double snr_db = links_.snr_db(static_cast<std::size_t>(f.station));
  if (settings_.radio.adapt_rate) {
    f.rate_Mbps =
        best_rate_mbps(settings_.rate_Mbps, f.bytes, snr_db, settings_.radio.highest_error_ratio);
    WifiPhy phy = phy_;
    phy.data_rate_Mbps = f.rate_Mbps;
    phy.control_rate_Mbps = control_rate_mbps(settings_.control_rate_Mbps, f.rate_Mbps);
    const Frame timed = unicast_frame(phy, f.bytes, settings_.eifs);
    f.air = timed.air;
    f.exchange = timed.exchange;
    f.wasted = timed.wasted;
  }
  f.error_ratio = errors_at(f, snr_db);
}

double WifiStations::errors_at(const Frame& f, double sinr_db) const {
  const double kept = 1.0 - frame_error_ratio(f.rate_Mbps, frame_bits(f.bytes), sinr_db);
  return 1.0 - (1.0 - settings_.error_ratio) * kept;
}

/// Capture at the frame's access point. An access point that sends hears no other frame. Capture at
/// vehicles is not modelled, because their mutual SNR is not known; nor is capture of frames whose
/// SNR is not known.
double WifiStations::errors_among(std::span<const Frame> frames, std::size_t which) const {
  const bool is_known = std::all_of(frames.begin(), frames.end(), [](const Frame& f) {
    return !f.down && f.station != Frame::kAnybody;
  });
  if (!is_known) return 1.0;
  const auto station = static_cast<std::size_t>(frames[which].station);
  const std::size_t receiver = links_.access_point(station);
  double noise = 1.0;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    if (k == which) continue;
    const auto other = static_cast<std::size_t>(frames[k].station);
    noise += std::pow(10.0, 0.1 * links_.snr_db(other, receiver));
  }
  const double sinr_db = links_.snr_db(station, receiver) - 10.0 * std::log10(noise);
  return sinr_db > *settings_.radio.capture_sinr_db ? errors_at(frames[which], sinr_db) : 1.0;
}

/// Contender for a vehicle's frames up, or for those to it from its access point.
std::size_t WifiStations::contender_of(std::size_t vehicle, bool down) const {
  const Vehicle& v = vehicles_[vehicle];
  if (!down) return v.contender;
  return access_points_[links_.access_point(static_cast<std::size_t>(v.station))].at(
      settings_.category);
}

bool WifiStations::push(Instant now, std::size_t vehicle, bool down, std::uint64_t id, int bytes) {
  settle(now);
  Frame pushed = frame(bytes, vehicles_[vehicle].station, down);
  pushed.id = id;
  pushed.luck = split_mix(vehicles_[vehicle].luck[down ? 1 : 0]++);
  if (roaming_.is_away(vehicle)) return roaming_.hold(now, vehicle, pushed);
  return contention_.push(now, contender_of(vehicle, down), pushed);
}

void WifiStations::on_position(std::size_t vehicle, double x_m, double y_m, Instant now) {
  settle(now);
  contention_.catch_up(now);
  const std::size_t before = contender_of(vehicle, true);
  const Vehicle& v = vehicles_[vehicle];
  const auto station = static_cast<std::size_t>(v.station);
  links_.move(station, x_m, y_m);
  if (roaming_.is_away(vehicle) || !links_.choose(station)) return;
  Roaming::Frames queued = contention_.take(now, v.contender, v.station);
  for (auto& waiting : contention_.take(now, before, v.station)) queued.push_back(waiting);
  lose(now, roaming_.leave(now, vehicle, queued));
  settle(now);
}

void WifiStations::lose(Instant now, const Roaming::Frames& frames) {
  for (const FrameQueue::Waiting& waiting : frames) ended_({waiting.frame.id, false, now, 0});
}

void WifiStations::come_back(const Roaming::Return& back) {
  lose(back.at, back.expired);
  for (const FrameQueue::Waiting& waiting : back.frames) {
    const std::size_t contender = contender_of(back.vehicle, waiting.frame.down);
    if (!contention_.push(back.at, contender, waiting)) lose(back.at, {waiting});
  }
}

/// All that comes to queues by `now`, in order of time.
void WifiStations::settle(Instant now) {
  while (const auto back = roaming_.come_back(now)) {
    arrive(back->at);
    come_back(*back);
  }
  arrive(now);
}

Instant WifiStations::next_event() const {
  return std::min({contention_.next_event(), background_.next_arrival(), roaming_.next_return()});
}

void WifiStations::advance(Instant now) {
  settle(now);
  contention_.advance(now);
}

void WifiStations::arrive(Instant now) {
  background_.arrivals(now, [this](Instant at, std::size_t i, int bytes) {
    for (const int size : fragment_bytes(bytes)) {
      Frame fragment =
          frame(size + kWifiOverheadBytes, background_stations_[i], background_.of(i).down);
      fragment.id = BackgroundTraffic::kId;
      contention_.push(at, background_contenders_[i], fragment);
    }
  });
}

}  // namespace tether
