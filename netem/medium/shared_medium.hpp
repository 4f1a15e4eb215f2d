#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <queue>
#include <string>
#include <utility>
#include <vector>

#include "common/base/counters.hpp"
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

/// From a vehicle to the access point or base station, or to it.
enum class Way { up, down };

/// Fate of a packet.
struct PacketFateOnAir {
  std::uint64_t id = 0;
  bool delivered = false;
  Instant at{};  ///< at the other end; of one that is lost: when that is decided
};

/// The medium of all vehicles: the one of [medium] that its model names. Packets longer than a
/// frame are sent in fragments, all of which have to arrive. Pure: time goes forward only.
class SharedMedium {
 public:
  using Ended = std::function<void(const PacketFateOnAir&)>;

  virtual ~SharedMedium() = default;
  SharedMedium(const SharedMedium&) = delete;
  SharedMedium& operator=(const SharedMedium&) = delete;

  /// A vehicle's two ways; returns its number, from 0 on. Its random streams are
  /// "<name>/medium/…": one more vehicle changes no other's draws.
  virtual std::size_t add_vehicle(const std::string& name) = 0;

  /// Whether where vehicles are matters.
  virtual bool wants_position() const { return false; }
  /// Where a vehicle is from `now` on; (0, 0) before the first time.
  virtual void on_position(std::size_t /*vehicle*/, double /*x_m*/, double /*y_m*/,
                           Instant /*now*/) {}

  /// Sends a packet of `bytes` of UDP payload. The last word on it, `ended`, comes from this call,
  /// a later one of advance(), or, where a newer packet replaces it, of send(); of packets that
  /// find no room, or are longer than a datagram can be (65 507 bytes), at once.
  void send(Instant now, std::size_t vehicle, Way way, std::uint64_t id, int bytes);

  /// When advance() is to be called next while packets are under way; else Instant::max().
  Instant next_event() const;
  /// All that begins by `now`.
  virtual void advance(Instant now) = 0;

  std::size_t under_way() const { return pending_.size(); }
  /// "medium.delivered", .lost, .overflowed …
  void list(CounterList& out) const;

  /// Value of a packet under way for its receiver, by its id; the sender knows.
  using Value = std::function<double(std::uint64_t id)>;

  /// nullptr for none. The random streams are derived from `seed`. `value`: asked for with serve =
  /// "most_valuable"; without it all are worth the same.
  static std::unique_ptr<SharedMedium> make(const MediumSettings& settings, std::uint64_t seed,
                                            Ended ended, Value value = nullptr);

 protected:
  explicit SharedMedium(Ended ended) : ended_(std::move(ended)) {}

  /// False if there is no room.
  virtual bool push(Instant now, std::size_t vehicle, Way way, std::uint64_t fragment,
                    int bytes) = 0;
  virtual Instant next_transmission() const = 0;
  virtual void list_own(CounterList& out) const = 0;
  /// Fate of a fragment. A packet is lost for the reason of its first fragment that is.
  enum class End { delivered, all_attempts_failed, not_sent_in_time, no_room };
  void fragment_ended(std::uint64_t fragment, End end, Instant at);
  /// Contention and ScheduledCell have dropped what they did not attempt.
  static End end_of(bool delivered, int attempts) {
    if (delivered) return End::delivered;
    return attempts > 0 ? End::all_attempts_failed : End::not_sent_in_time;
  }

 private:
  struct Pending {
    int fragments = 0;
    End end = End::delivered;
    Instant at{};
  };
  Ended ended_;
  std::map<std::uint64_t, Pending> pending_;
  std::int64_t sent_ = 0, lost_ = 0, too_long_ = 0;
  std::array<std::int64_t, 4> ends_{};  ///< packets, by End
};

/// Sizes of one packet's fragments on Ethernet and Wi-Fi, with UDP and IP headers: the sizes of its
/// fragments.
std::vector<int> fragment_bytes(int udp_payload_bytes);

}  // namespace tether
