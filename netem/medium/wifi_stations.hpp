#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "netem/medium/contention.hpp"
#include "netem/medium/frame_queue.hpp"
#include "netem/medium/medium_settings.hpp"
#include "netem/medium/radio_settings.hpp"
#include "netem/medium/shared_medium.hpp"
#include "netem/medium/wifi_airtime.hpp"

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

/// Handling of the frames of a vehicle that changes its access point: for some time none passes in
/// either direction. Pure: time goes forward only.
class Roaming {
 public:
  struct Rules {
    Duration away{};
    bool waits = true;   ///< frames wait for the end; else they are lost
    QueueLimits limits;  ///< limits of waiting packets, per vehicle and direction
  };
  using Frames = std::vector<FrameQueue::Waiting>;

  explicit Roaming(const Rules& rules) : rules_(rules) {}

  void add_vehicle() { vehicles_.emplace_back(); }

  /// From `now` on it is away, which it was not. `queued`: its frames that were on neither side
  /// yet. Returns those that are lost.
  Frames leave(Instant now, std::size_t vehicle, const Frames& queued);
  bool is_away(std::size_t vehicle) const { return vehicles_[vehicle].until.has_value(); }
  /// False if a frame of a vehicle that is away is lost.
  bool hold(Instant since, std::size_t vehicle, const Frame& frame);

  /// Time when the next roaming vehicle is back; Instant::max() if no vehicle is away.
  Instant next_return() const;
  struct Return {
    Instant at;
    std::size_t vehicle;
    Frames frames, expired;
  };
  /// First vehicle to be back by `now`, which is then not away any more; nullopt: none.
  std::optional<Return> come_back(Instant now);

  struct Counters {
    std::int64_t changes = 0;
    std::int64_t held = 0;  ///< frames that waited
    std::int64_t lost = 0;  ///< frames that did not, or not until the end
  };
  const Counters& counters() const { return counters_; }

 private:
  struct Vehicle {
    std::optional<Instant> until;
    Frames held;
  };
  Rules rules_;
  std::vector<Vehicle> vehicles_;
  std::size_t away_ = 0;
  Counters counters_;
};

WifiPhy phy_of(const MediumSettings& settings);

/// The stations on one channel of Wi-Fi: access points, which have everything that goes down, with
/// EDCA in a queue for each category, the vehicles, and those of [[medium.background]], which are
/// dealt out to the access points in turn.
class WifiStations {
 public:
  WifiStations(const MediumSettings& settings, std::uint64_t seed, Contention::Ended ended);

  /// Returns its number, from 0 on. Its backoff is drawn from the stream "<name>/medium/backoff".
  /// Noise is a function of seed, name, direction, number of the frame and attempt: of no other
  /// station, but for the attempts that collide.
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
    std::size_t contender;              ///< contender of the uplink
    int station;                        ///< index in links_
    std::array<std::uint64_t, 2> luck;  ///< luck of its next frame, up and down
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
  std::vector<Vehicle> vehicles_;
  Roaming roaming_;
};

}  // namespace tether
