#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "netem/medium/background_traffic.hpp"
#include "netem/medium/contention.hpp"
#include "netem/medium/medium_settings.hpp"
#include "netem/medium/radio_links.hpp"
#include "netem/medium/roaming.hpp"
#include "netem/medium/wifi_airtime.hpp"

namespace tether {

WifiPhy phy_of(const MediumSettings& settings);

/// The stations on one channel of Wi-Fi: access points, which have everything that goes down, with
/// EDCA in a queue for each category, the vehicles, and those of [[medium.background]], which are
/// dealt out to the access points in turn.
class WifiStations {
 public:
  WifiStations(const MediumSettings& settings, std::uint64_t seed, Contention::Ended ended);

  /// Returns its number, from 0 on; its random streams are "<name>/medium/backoff" and, with a
  /// radio, "<name>/medium/noise".
  std::size_t add_vehicle(const std::string& name);

  /// A frame of `bytes` with all headers, up or down. False if there is no room for it.
  bool push(Instant now, std::size_t vehicle, bool down, std::uint64_t id, int bytes);

  bool wants_position() const { return links_.wants_position(); }
  /// Moves the vehicle. Frames that began before `now` keep the previous position.
  void on_position(std::size_t vehicle, double x_m, double y_m, Instant now);

  Instant next_event() const;
  void advance(Instant now);
  const Contention::Counters& counters() const { return contention_.counters(); }
  /// Whether there are several access points.
  bool roams() const { return access_points_.size() > 1; }
  const Roaming::Counters& roaming() const { return roaming_.counters(); }

 private:
  AccessParameters access_of(const std::string& category) const;
  QueueLimits limits() const;
  void add_access_points();
  void add_access_point(std::size_t number);
  void add_background();
  Frame frame(int bytes, int station, bool down) const;
  void renew(Frame& frame) const;
  double errors_at(const Frame& frame, double sinr_db) const;
  double errors_among(std::span<const Frame> frames, std::size_t which) const;
  std::size_t contender_of(std::size_t vehicle, bool down) const;
  void come_back(const Roaming::Return& back);
  void lose(Instant now, const Roaming::Frames& frames);
  void settle(Instant now);
  void arrive(Instant now);

  struct Vehicle {
    std::size_t contender;  ///< contender of the uplink
    int station;            ///< index in links_
    RandomEngine noise;     ///< noise of its frames both ways; queued frames refer to it
  };
  MediumSettings settings_;
  std::uint64_t seed_;
  WifiPhy phy_;
  Contention::Ended ended_;
  Contention contention_;
  using Queues = std::map<std::string, std::size_t>;  ///< by category
  std::vector<Queues> access_points_;
  BackgroundTraffic background_;
  std::vector<std::size_t> background_contenders_;
  std::vector<int> background_stations_;  ///< indices in links_
  RadioLinks links_;
  std::deque<Vehicle> vehicles_;
  Roaming roaming_;
};

}  // namespace tether
