#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "netem/medium/medium_settings.hpp"

namespace tether {

/// [[medium.background]] preset: traffic of mobile robots in factories, after 3GPP TS 22.104
/// (clause A.2.2.3 and the tables of clause 5). Rows give ranges; a preset takes the largest
/// message and the longest transfer interval, of video the smallest message, which a datagram can
/// hold. What is given beside it beats it.
struct TrafficPreset {
  const char* name;
  MediumSettings::Background::Kind kind;
  double rate_hz;
  std::int64_t bytes;
  const char* what;
  /// Read in the standard's own text (V19, table of aperiodic services). The periodic rows were
  /// not: they are as others cite them.
  bool verified;
};

inline constexpr std::array<TrafficPreset, 7> kTrafficPresets{{
    {"cooperative_motion", MediumSettings::Background::Kind::periodic, 1000.0, 250,
     "40 to 250 bytes each 1 ms", false},
    {"machine_control", MediumSettings::Background::Kind::periodic, 100.0, 250,
     "40 to 250 bytes each 1 to 10 ms", false},
    {"cooperative_driving", MediumSettings::Background::Kind::periodic, 20.0, 250,
     "40 to 250 bytes each 10 to 50 ms", false},
    {"video_remote_control", MediumSettings::Background::Kind::periodic, 10.0, 15'000,
     "15 to 250 kB each 10 to 100 ms", false},
    {"traffic_management", MediumSettings::Background::Kind::periodic, 2.0, 250,
     "40 to 250 bytes each 40 to 500 ms", false},
    {"video_streaming", MediumSettings::Background::Kind::poisson, 893.0, 1400,
     "10 Mbit/s up, in packets of 1400 bytes", true},
    {"emergency_stop", MediumSettings::Background::Kind::poisson, 125.0, 250,
     "of an operation panel: 250 kbit/s, 40 to 250 bytes", true},
}};

/// nullptr if no element has that name.
inline const TrafficPreset* traffic_preset(const std::string& name) {
  for (const TrafficPreset& preset : kTrafficPresets) {
    if (name == preset.name) return &preset;
  }
  return nullptr;
}

}  // namespace tether
