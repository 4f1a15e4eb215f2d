#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "netem/medium/radio_settings.hpp"

namespace tether {

/// How well stations and access points hear each other: the ratio of signal to noise at 20 MHz, the
/// same in both directions.
///
/// In a hall it is power − path loss − noise, and noise −174 dBm/Hz + noise figure. What stands in
/// the way of an access point does so for every vehicle and at any time: its random stream is
/// "medium/access point/<x_m>,<y_m>/radio".
class RadioLinks {
 public:
  RadioLinks(const RadioSettings& settings, std::uint64_t seed);

  /// A vehicle; in a hall it is at (0, 0) until it moves. Returns its number, from 0 on, which it
  /// shares with other stations.
  std::size_t add();
  /// One that is heard like this by whatever access point.
  std::size_t add(double snr_db);

  bool wants_position() const { return settings_.model == RadioSettings::Model::hall; }
  /// Ways of less than 0.1 m change nothing.
  void move(std::size_t station, double x_m, double y_m);
  /// Lets a station that has moved choose its access point. True if it leaves one for another,
  /// which it does not when it chooses its first.
  bool choose(std::size_t station);

  double snr_db(std::size_t station) const { return snr_db(station, access_point(station)); }
  double snr_db(std::size_t station, std::size_t access_point) const;
  /// The one that a station talks to: that which it heard best in its first place, until it hears
  /// another better by more than the hysteresis, which then is the one that it hears best.
  std::size_t access_point(std::size_t station) const { return stations_[station].access_point; }

 private:
  struct Station {
    std::optional<double> fixed_db;
    double x_m = 0.0, y_m = 0.0;
    std::vector<double> snr_db = {};  ///< by access point
    std::size_t access_point = 0;
    bool has_chosen = false;
  };
  void listen(Station& station) const;
  static std::size_t best(const Station& station);

  RadioSettings settings_;
  std::vector<IndoorFactoryMap> maps_;  ///< by access point
  std::vector<Station> stations_;
};

}  // namespace tether
