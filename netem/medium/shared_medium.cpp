#include "netem/medium/shared_medium.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>

#include "netem/medium/background_traffic.hpp"
#include "netem/medium/cell/scheduled_cell.hpp"
#include "netem/medium/wifi_stations.hpp"

namespace tether {
namespace {

constexpr int kUdpHeader = 8, kIpHeader = 20, kMostIpPayload = 1480, kLongestDatagram = 65'507;
/// Fragments of a packet have its number times this, and count.
constexpr std::uint64_t kFragments = 64;

class WifiMedium final : public SharedMedium {
 public:
  WifiMedium(const MediumSettings& settings, std::uint64_t seed, Ended ended)
      : SharedMedium(std::move(ended)), stations_(settings, seed, [this](const FrameEnd& end) {
          fragment_ended(end.id, end.delivered, end.at);
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
      if (end.id != BackgroundTraffic::kId) fragment_ended(end.id, end.delivered, end.at);
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
    if (!push(now, vehicle, way, fragment, sizes[i])) fragment_ended(fragment, false, now);
  }
}

void SharedMedium::fragment_ended(std::uint64_t fragment, bool delivered, Instant at) {
  const std::uint64_t id = fragment / kFragments;
  const auto found = pending_.find(id);
  assert(found != pending_.end());
  Pending& packet = found->second;
  packet.lost |= !delivered;
  packet.at = std::max(packet.at, at);
  if (--packet.fragments > 0) return;
  const PacketFateOnAir fate{id, !packet.lost, packet.at};
  pending_.erase(found);
  ++(fate.delivered ? delivered_ : lost_);
  ended_(fate);
}

Instant SharedMedium::next_event() const {
  return pending_.empty() ? Instant::max() : next_transmission();
}

void SharedMedium::list(CounterList& out) const {
  out.emplace_back("medium.sent", sent_);
  out.emplace_back("medium.delivered", delivered_);
  out.emplace_back("medium.lost", lost_);
  if (too_long_ > 0) out.emplace_back("medium.too_long", too_long_);
  list_own(out);
}

}  // namespace tether
