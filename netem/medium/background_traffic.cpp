#include "netem/medium/background_traffic.hpp"

#include <fmt/format.h>

#include <boost/random/exponential_distribution.hpp>
#include <utility>

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

}  // namespace tether
