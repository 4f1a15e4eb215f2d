#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "netem/medium/medium_settings.hpp"
#include "netem/medium/shared_medium.hpp"
#include "netem/medium/wifi_airtime.hpp"
#include "netem/medium/wifi_stations.hpp"

namespace tether {
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

std::string overload_warning(const MediumSettings& settings) {
  const OfferedLoad load = offered_load(settings);
  if (load.saturated > 0) return of_saturated(load);
  if (load.most < 1.0) return "";
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
