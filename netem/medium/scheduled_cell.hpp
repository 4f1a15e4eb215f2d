#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <vector>

#include "common/base/random.hpp"
#include "common/base/time.hpp"

namespace tether {

/// How a cell grants its uplink: what of 5G NR's MAC (TS 38.321) decides delays, and nothing else.
struct ScheduledRules {
  /// A user with something new to send waits for its next opportunity to ask, one each this long,
  /// at a phase of its own. proactive: grants are given at these times without being asked for.
  Duration request_period = std::chrono::milliseconds{20};
  /// From then on until its packet may be sent: grant, preparation, what the fixed network takes.
  Duration offset = std::chrono::microseconds{2500};
  Duration slot = std::chrono::microseconds{500};        ///< transmissions begin and end with slots
  double rate_Mbps = 50.0;                               ///< of the cell; one user at a time
  double error_ratio = 0.0;                              ///< of a transmission (BLER)
  Duration repeat_after = std::chrono::milliseconds{8};  ///< HARQ: from its end to the next
  int attempts = 4;                                      ///< of a packet, then it is lost
  std::size_t queue = 100;                               ///< packets of a user; others are refused
};

/// A packet's end in the cell.
struct PacketEnd {
  std::uint64_t id = 0;
  bool delivered = false;
  Instant at{};
  int attempts = 0;
};

/// The uplink of one cell, shared by users in turn. Pure: time goes forward only. Each user has a
/// random stream of its own (phase of its requests, errors), so that one more changes no other's
/// luck.
///
/// A user asks once for all that it has. A packet that comes while earlier ones of the user wait
/// for their grant is granted with them; later ones go in the same turn order without asking again
/// while the user has something to send (buffer status reports go with data).
/// Of users with granted packets, the one after the last served is next (round robin), unless
/// `urgency` says otherwise. Unloaded, a packet's delay is uniform on [0, request_period), plus
/// offset, plus waiting for a slot, its own slots, and (repeat_after + its slots) for each repeat.
class ScheduledCell {
 public:
  using Ended = std::function<void(const PacketEnd&)>;
  /// Of a user whose oldest packet came at `since`, at `now`: the largest goes first.
  using Urgency = std::function<double(std::size_t user, Instant since, Instant now)>;

  ScheduledCell(const ScheduledRules& rules, std::uint64_t seed, Ended ended);

  /// Returns its number, from 0 on. `name`: of its random stream.
  std::size_t add(const std::string& name);
  void set_urgency(Urgency urgency) { urgency_ = std::move(urgency); }

  /// False if its queue is full.
  bool push(Instant now, std::size_t user, std::uint64_t id, int bytes);

  /// When the next transmission begins; Instant::max() if nothing is to be sent.
  Instant next_event() const;
  /// All transmissions that begin by `now`.
  void advance(Instant now);

  struct Counters {
    std::int64_t transmissions = 0;
    std::int64_t delivered = 0;
    std::int64_t lost = 0;
    std::int64_t overflowed = 0;
    Duration busy{};
  };
  const Counters& counters() const { return counters_; }
  std::size_t waiting(std::size_t user) const { return users_[user].packets.size(); }
  Duration airtime(int bytes) const;

 private:
  struct Packet {
    std::uint64_t id;
    int bytes;
    Instant since;
    Instant granted;  ///< may be sent from here on
    int attempts = 0;
  };
  struct User {
    Duration phase;
    std::deque<Packet> packets;
    RandomEngine random;
  };

  Instant slot_at_or_after(Instant t) const;
  Instant next_request(const User& user, Instant now) const;
  std::size_t choose(Instant now) const;
  void transmit(Instant start);

  ScheduledRules rules_;
  std::uint64_t seed_;
  Ended ended_;
  Urgency urgency_;
  std::vector<User> users_;
  std::size_t last_ = 0;        ///< served
  Instant free_from_ = kStart;  ///< the cell
  Counters counters_;
};

}  // namespace tether
