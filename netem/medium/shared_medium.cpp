#include "netem/medium/shared_medium.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/random/exponential_distribution.hpp>
#include <cassert>
#include <cmath>
#include <utility>

#include "netem/medium/medium_settings.hpp"
#include "netem/medium/scheduled_cell.hpp"
#include "netem/medium/wifi_airtime.hpp"
#include "netem/medium/wifi_stations.hpp"

namespace tether {

using Kind = MediumSettings::Background::Kind;

BackgroundTraffic::BackgroundTraffic(const MediumSettings& settings, std::uint64_t seed) {
  for (const MediumSettings::Background& kind : settings.background) {
    for (std::int64_t i = 0; i < kind.stations; ++i) {
      add(kind, fmt::format("medium/background/{}", stations_.size() + 1), seed);
    }
  }
  for (std::int64_t i = 1; i <= settings.others; ++i) {
    for (const auto& [stream, down] : {std::pair{settings.up, false}, {settings.down, true}}) {
      if (stream.rate_hz <= 0.0) continue;
      add({Kind::periodic, 1, stream.rate_hz, stream.bytes, settings.category, down},
          fmt::format("medium/other/{}/{}", i, down ? "down" : "up"), seed);
    }
  }
}

void BackgroundTraffic::add(const MediumSettings::Background& kind, const std::string& name,
                            std::uint64_t seed) {
  Station& station =
      stations_.emplace_back(Station{kind, name, random_stream(seed, name + "/traffic")});
  if (kind.kind == Kind::saturated) return;
  next_.emplace(kStart + from_seconds(uniform_01(station.random) / kind.rate_hz),
                stations_.size() - 1);
}

Duration BackgroundTraffic::pause(Station& station) {
  const double share = station.kind.kind == Kind::periodic
                           ? 1.0
                           : boost::random::exponential_distribution<double>()(station.random);
  return from_seconds(share / station.kind.rate_hz);
}

Instant BackgroundTraffic::next_arrival() const {
  return next_.empty() ? Instant::max() : next_.top().first;
}

namespace {

constexpr int kUdpHeader = 8, kIpHeader = 20, kMostIpPayload = 1480, kLongestDatagram = 65'507;
/// Fragments of a packet have its number times this, and count.
constexpr std::uint64_t kFragments = 64;

class WifiMedium final : public SharedMedium {
 public:
  WifiMedium(const MediumSettings& settings, std::uint64_t seed, Ended ended)
      : SharedMedium(std::move(ended)), stations_(settings, seed, [this](const FrameEnd& end) {
          fragment_ended(end.id, end_of(end.delivered, end.attempts), end.at);
        }) {}

  std::size_t add_vehicle(const std::string& name) override { return stations_.add_vehicle(name); }

  bool wants_position() const override { return stations_.wants_position(); }
  void on_position(std::size_t vehicle, double x_m, double y_m, Instant now) override {
    stations_.on_position(vehicle, x_m, y_m, now);
  }
  void advance(Instant now) override { stations_.advance(now); }

 protected:
  bool push(Instant now, std::size_t vehicle, Way way, std::uint64_t fragment, int bytes) override {
    return stations_.push(now, vehicle, way == Way::down, fragment, bytes + kWifiOverheadBytes);
  }
  Instant next_transmission() const override { return stations_.next_event(); }
  void list_own(CounterList& out) const override {
    const Contention::Counters& c = stations_.counters();
    out.emplace_back("medium.transmissions", c.transmissions);
    out.emplace_back("medium.collisions", c.collisions);
    out.emplace_back("medium.frames.corrupted", c.corrupted);
    if (c.captured > 0) out.emplace_back("medium.frames.captured", c.captured);
    out.emplace_back("medium.frames.dropped", c.dropped);
    out.emplace_back("medium.frames.expired", c.expired);
    out.emplace_back("medium.frames.overflowed", c.overflowed);
    out.emplace_back("medium.busy_us", c.busy / std::chrono::microseconds{1});
    const Roaming::Counters& roaming = stations_.roaming();
    if (!stations_.roams()) return;
    out.emplace_back("medium.roaming.changes", roaming.changes);
    out.emplace_back("medium.roaming.held", roaming.held);
    out.emplace_back("medium.roaming.lost", roaming.lost);
  }

 private:
  WifiStations stations_;
};

ScheduledRules rules_of(const MediumSettings& settings, Way way) {
  ScheduledRules rules;
  rules.slot = from_seconds(settings.slot_ms * 1e-3);
  // The base station knows what it has to send: no request, no grant.
  rules.request_period =
      way == Way::up ? from_seconds(settings.request_period_ms * 1e-3) : Duration{1};
  rules.offset = from_seconds(settings.offset_ms * 1e-3);
  rules.rate_Mbps = settings.rate_Mbps;
  rules.error_ratio = settings.error_ratio;
  rules.repeat_after = from_seconds(settings.repeat_after_ms * 1e-3);
  rules.attempts = settings.attempts;
  rules.queue = static_cast<std::size_t>(settings.queue);
  rules.serve = settings.serve;
  rules.ids_of_a_message = kFragments;
  return rules;
}

class CellMedium final : public SharedMedium {
 public:
  CellMedium(const MediumSettings& settings, std::uint64_t seed, Ended ended, Value value)
      : SharedMedium(std::move(ended)),
        up_(rules_of(settings, Way::up), seed, told()),
        down_(rules_of(settings, Way::down), seed, told()),
        keep_newest_(settings.keep_newest),
        background_(settings, seed) {
    if (value) {
      for (ScheduledCell* cell : {&up_, &down_}) {
        cell->set_value([value](std::uint64_t id) {
          return id == BackgroundTraffic::kId ? 0.0 : value(id / kFragments);
        });
      }
    }
    for (std::size_t i = 0; i < background_.size(); ++i) {
      users_.push_back(
          (background_.of(i).down ? down_ : up_).add(background_.name(i), {.has_age = false}));
    }
  }

  std::size_t add_vehicle(const std::string& name) override {
    vehicles_.push_back(up_.add(name + "/medium/up", {.keeps_newest = keep_newest_}));
    vehicles_down_.push_back(down_.add(name + "/medium/down", {.keeps_newest = keep_newest_}));
    return vehicles_.size() - 1;
  }

  void advance(Instant now) override {
    arrive(now);
    up_.advance(now);
    down_.advance(now);
  }

 protected:
  bool push(Instant now, std::size_t vehicle, Way way, std::uint64_t fragment, int bytes) override {
    arrive(now);
    if (way == Way::down) return down_.push(now, vehicles_down_[vehicle], fragment, bytes);
    return up_.push(now, vehicles_[vehicle], fragment, bytes);
  }
  Instant next_transmission() const override {
    return std::min({up_.next_event(), down_.next_event(), background_.next_arrival()});
  }
  void list_own(CounterList& out) const override {
    for (const auto& [cell, name] : {std::pair{&up_, "up"}, std::pair{&down_, "down"}}) {
      const ScheduledCell::Counters& c = cell->counters();
      out.emplace_back(fmt::format("medium.{}.transmissions", name), c.transmissions);
      out.emplace_back(fmt::format("medium.{}.packets.lost", name), c.lost);
      out.emplace_back(fmt::format("medium.{}.packets.overflowed", name), c.overflowed);
      if (keep_newest_) {
        out.emplace_back(fmt::format("medium.{}.packets.replaced", name), c.replaced);
      }
      out.emplace_back(fmt::format("medium.{}.busy_us", name),
                       c.busy / std::chrono::microseconds{1});
    }
  }

 private:
  ScheduledCell::Ended told() {
    return [this](const PacketEnd& end) {
      if (end.id == BackgroundTraffic::kId) return;
      fragment_ended(end.id, end_of(end.delivered, end.attempts), end.at);
    };
  }
  void arrive(Instant now) {
    background_.arrivals(now, [this](Instant at, std::size_t i, int bytes) {
      (background_.of(i).down ? down_ : up_).push(at, users_[i], BackgroundTraffic::kId, bytes);
    });
  }

  ScheduledCell up_, down_;
  bool keep_newest_;
  BackgroundTraffic background_;
  std::vector<std::size_t> users_;                     ///< users of the background: in up_ or down_
  std::vector<std::size_t> vehicles_, vehicles_down_;  ///< in up_ and in down_
};

}  // namespace

std::vector<int> fragment_bytes(int udp_payload_bytes) {
  std::vector<int> sizes;
  for (int left = udp_payload_bytes + kUdpHeader; left > 0; left -= kMostIpPayload) {
    sizes.push_back(std::min(left, kMostIpPayload) + kIpHeader);
  }
  return sizes;
}

std::unique_ptr<SharedMedium> SharedMedium::make(const MediumSettings& settings, std::uint64_t seed,
                                                 Ended ended, Value value) {
  if (settings.model == MediumSettings::Model::none) return nullptr;
  if (settings.is_wifi()) return std::make_unique<WifiMedium>(settings, seed, std::move(ended));
  return std::make_unique<CellMedium>(settings, seed, std::move(ended), std::move(value));
}

void SharedMedium::send(Instant now, std::size_t vehicle, Way way, std::uint64_t id, int bytes) {
  ++sent_;
  if (bytes > kLongestDatagram) {
    ++too_long_;
    ++lost_;
    return ended_({id, false, now});
  }
  const std::vector<int> sizes = fragment_bytes(bytes);
  assert(sizes.size() <= kFragments);
  pending_[id].fragments = static_cast<int>(sizes.size());
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    const std::uint64_t fragment = id * kFragments + i;
    if (!push(now, vehicle, way, fragment, sizes[i])) fragment_ended(fragment, End::no_room, now);
  }
}

void SharedMedium::fragment_ended(std::uint64_t fragment, End end, Instant at) {
  const std::uint64_t id = fragment / kFragments;
  const auto found = pending_.find(id);
  assert(found != pending_.end());
  Pending& packet = found->second;
  if (packet.end == End::delivered) packet.end = end;
  packet.at = std::max(packet.at, at);
  if (--packet.fragments > 0) return;
  const PacketFateOnAir fate{id, packet.end == End::delivered, packet.at};
  ++ends_[static_cast<std::size_t>(packet.end)];
  pending_.erase(found);
  if (!fate.delivered) ++lost_;
  ended_(fate);
}

Instant SharedMedium::next_event() const {
  return pending_.empty() ? Instant::max() : next_transmission();
}

void SharedMedium::list(CounterList& out) const {
  out.emplace_back("medium.sent", sent_);
  const auto of = [this](End end) { return ends_[static_cast<std::size_t>(end)]; };
  out.emplace_back("medium.delivered", of(End::delivered));
  out.emplace_back("medium.lost", lost_);
  if (lost_ > 0) {
    out.emplace_back("medium.lost.attempts", of(End::all_attempts_failed));
    out.emplace_back("medium.lost.late", of(End::not_sent_in_time));
    out.emplace_back("medium.lost.no_room", of(End::no_room));
  }
  if (too_long_ > 0) out.emplace_back("medium.too_long", too_long_);
  list_own(out);
}

namespace {

using Background = MediumSettings::Background;
using Stream = MediumSettings::Stream;

constexpr std::int64_t kMostInAFrame = 1472;  ///< a saturated station sends no fragments

double airtime_s(const MediumSettings& medium, std::int64_t bytes) {
  double sum_s = 0.0;
  for (const int size : fragment_bytes(static_cast<int>(bytes))) {
    if (medium.is_wifi()) {
      const WifiPhy phy = phy_of(medium);
      sum_s += to_seconds(unicast_frame(phy, size + kWifiOverheadBytes, false).exchange + phy.sifs);
    } else {
      const double slot_s = medium.slot_ms * 1e-3;
      sum_s += std::ceil(8e-6 * size / medium.rate_Mbps / slot_s - 1e-9) * slot_s;
    }
  }
  return sum_s;
}

/// Up and down.
struct Ways {
  double up = 0.0, down = 0.0;
  double of(const MediumSettings& settings) const {
    return settings.is_wifi() ? up + down : std::max(up, down);
  }
};

template <class Rate>
Ways asked(const MediumSettings& settings, Rate rate_of) {
  const auto fleet = static_cast<double>(settings.vehicles);
  const auto others = static_cast<double>(settings.others);
  const auto share = [&](const Stream& stream) {
    return rate_of(stream) * airtime_s(settings, stream.bytes);
  };
  Ways ways{(others + (settings.poses_go_up ? fleet : 0.0)) * share(settings.up),
            (others + fleet) * share(settings.down)};
  for (const Stream& stream : settings.more_up) ways.up += fleet * share(stream);
  for (const Background& b : settings.background) {
    if (b.kind == Background::Kind::saturated) continue;
    (b.down ? ways.down : ways.up) +=
        static_cast<double>(b.stations) * b.rate_hz * airtime_s(settings, b.bytes);
  }
  return ways;
}

/// Stations of one category that always have something to send succeed equally often (Bianchi).
void share_out(const MediumSettings& settings, const Ways& most, OfferedLoad& load) {
  double round_s = 0.0;
  bool equal = true;
  for (const Background& b : settings.background) {
    if (b.kind != Background::Kind::saturated) continue;
    load.saturated += b.stations;
    round_s +=
        static_cast<double>(b.stations) * airtime_s(settings, std::min(b.bytes, kMostInAFrame));
    equal &= settings.model == MediumSettings::Model::dcf || b.category == settings.category;
  }
  const Stream& down = settings.down;
  const auto frames = static_cast<double>(fragment_bytes(static_cast<int>(down.bytes)).size());
  load.down_hz =
      static_cast<double>(settings.vehicles + settings.others) * down.highest_hz() * frames;
  if (load.saturated == 0 || !equal || load.down_hz <= 0.0) return;
  round_s += airtime_s(settings, down.bytes) / frames;
  load.most_down_hz = std::max(0.0, 1.0 - most.up) / round_s;
}

std::string of_saturated(const OfferedLoad& load) {
  std::string text = fmt::format(
      "[medium] has {} saturated station{}, and no time left: {:.0f} % that others ask for, they "
      "have to win from {}",
      load.saturated, load.saturated == 1 ? "" : "s", 100.0 * load.most,
      load.saturated == 1 ? "it" : "them");
  if (!load.most_down_hz) return text;
  return text + fmt::format(
                    "; the access point sends at most {:.0f} frames a second then, collisions not "
                    "counted, and is asked for {:.0f}",
                    *load.most_down_hz, load.down_hz);
}

}  // namespace

OfferedLoad offered_load(const MediumSettings& settings) {
  if (settings.model == MediumSettings::Model::none) return {};
  const Ways most = asked(settings, [](const Stream& s) { return s.highest_hz(); });
  OfferedLoad load;
  load.least = asked(settings, [](const Stream& s) { return s.rate_hz; }).of(settings);
  load.most = most.of(settings);
  share_out(settings, most, load);
  return load;
}

std::string medium_warning(const MediumSettings& settings) {
  const OfferedLoad load = offered_load(settings);
  if (load.saturated > 0) return of_saturated(load);
  if (load.most < 1.0) {
    if (!settings.together || !settings.is_wifi()) return "";
    return fmt::format(
        "fleet.ticks = \"together\": {} vehicles send in the same instant, and most of their first "
        "attempts collide; timers of real vehicles drift apart (\"spread\")",
        settings.vehicles);
  }
  if (load.least >= 1.0) {
    return fmt::format(
        "[medium] is asked for {:.0f} % of its time, collisions not counted: it cannot carry all",
        100.0 * load.least);
  }
  return fmt::format(
      "[medium] is asked for up to {:.0f} % of its time, collisions not counted: that is if all "
      "poses and commands were sent; with send = \"changed\" it is {:.0f} % at least",
      100.0 * load.most, 100.0 * load.least);
}

}  // namespace tether
