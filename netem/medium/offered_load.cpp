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

}  // namespace

double offered_load(const MediumSettings& settings) {
  if (settings.model == MediumSettings::Model::none) return 0.0;
  const auto vehicles = static_cast<double>(settings.vehicles + settings.others);
  double up = vehicles * settings.up.rate_hz * airtime_s(settings, settings.up.bytes);
  double down = vehicles * settings.down.rate_hz * airtime_s(settings, settings.down.bytes);
  for (const Background& b : settings.background) {
    if (b.kind == Background::Kind::saturated) continue;
    (b.down ? down : up) +=
        static_cast<double>(b.stations) * b.rate_hz * airtime_s(settings, b.bytes);
  }
  return settings.is_wifi() ? up + down : std::max(up, down);
}

std::string overload_warning(const MediumSettings& settings) {
  const double load = offered_load(settings);
  if (load < 1.0) return "";
  return fmt::format(
      "[medium] is asked for {:.0f} % of its time, collisions not counted: it cannot carry all",
      100.0 * load);
}

}  // namespace tether
