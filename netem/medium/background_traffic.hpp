#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <queue>
#include <string>
#include <utility>
#include <vector>

#include "common/base/random.hpp"
#include "common/base/time.hpp"
#include "netem/medium/medium_settings.hpp"

namespace tether {

/// When the stations of [[medium.background]] that are not saturated have something to send: at
/// random (poisson), or in equal periods from a random phase on; and those of medium.others.
class BackgroundTraffic {
 public:
  /// Statistics of all their packets, whose fates have no receiver.
  static constexpr std::uint64_t kId = std::numeric_limits<std::uint64_t>::max();

  BackgroundTraffic(const MediumSettings& settings, std::uint64_t seed);

  /// All stations, in order, saturated ones too.
  std::size_t size() const { return stations_.size(); }
  const MediumSettings::Background& of(std::size_t station) const {
    return stations_[station].kind;
  }
  /// Name of its random streams.
  const std::string& name(std::size_t station) const { return stations_[station].name; }

  Instant next_arrival() const;
  /// Calls arrive(at, station, bytes) for each packet by `now`, in order of time.
  template <class Arrive>
  void arrivals(Instant now, Arrive arrive) {
    while (next_arrival() <= now) {
      const auto [at, which] = next_.top();
      next_.pop();
      Station& station = stations_[which];
      next_.emplace(at + pause(station), which);
      arrive(at, which, static_cast<int>(station.kind.bytes));
    }
  }

 private:
  struct Station {
    MediumSettings::Background kind;
    std::string name;
    RandomEngine random;
  };
  void add(const MediumSettings::Background& kind, const std::string& name, std::uint64_t seed);
  /// Until its next packet.
  static Duration pause(Station& station);

  using Arrival = std::pair<Instant, std::size_t>;  ///< when, and of which station
  std::vector<Station> stations_;
  std::priority_queue<Arrival, std::vector<Arrival>, std::greater<>> next_;
};

}  // namespace tether
