#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <utility>
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
  double rate_Mbps = 50.0;                               ///< rate of the cell; one user at a time
  double error_ratio = 0.0;                              ///< error ratio of a transmission (BLER)
  Duration repeat_after = std::chrono::milliseconds{8};  ///< HARQ: from its end to the next
  std::int64_t attempts = 4;  ///< maximum number for a packet, then it is lost
  std::size_t queue = 100;    ///< packets of a user; others are refused
  /// Who is next, of those who have something that is granted.
  enum class Serve {
    round_robin,  ///< the one after the last served
    /// Whose newest delivered message is the oldest, its time being that at which it was pushed:
    /// the one whose age of information is the largest. (Kadota et al.: Scheduling Policies for
    /// Minimizing Age of Information in Broadcast Wireless Networks. IEEE/ACM Trans. Netw. 26 (6),
    /// 2018, call it greedy, and prove it optimal for equal users.) Before all others come those of
    /// whom nothing was delivered; of equals, the one after the last served.
    oldest_first,
    /// Whose newest message has the largest Value: what its receiver does not know yet. Without a
    /// value: none. Of equals, the one after the last served.
    most_valuable
  };
  Serve serve = Serve::round_robin;
  /// A message is what was pushed at one time with ids that are the same but for the remainder of
  /// the division by this: a packet, or its fragments. It is delivered with its last one, if none
  /// of them was lost.
  std::uint64_t ids_of_a_message = 1;
};

/// Traffic of a user.
struct CellUser {
  /// A message replaces those of the user that wait and of which nothing was sent yet. They end as
  /// not delivered, in push(); it gets the grant that they had asked for.
  bool keeps_newest = false;
  /// They tell of a state, and are the worse the older they are. Else oldest_first takes for the
  /// user's age how long ago something of it was delivered: one whose queue only grows has always
  /// the oldest message, and would get all.
  bool has_age = true;
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
/// Of users with granted packets, `serve` says who is next (ScheduledRules), unless `urgency` does.
/// Unloaded, a packet's delay is uniform on [0, request_period), plus offset, plus waiting for a
/// slot, its own slots, and (repeat_after + its slots) for each repeat.
class ScheduledCell {
 public:
  using Ended = std::function<void(const PacketEnd&)>;
  /// Urgency at `now` of a user whose oldest packet came at `since`: the largest goes first.
  using Urgency = std::function<double(std::size_t user, Instant since, Instant now)>;

  /// Present value of a packet, by its id; for most_valuable.
  using Value = std::function<double(std::uint64_t id)>;

  ScheduledCell(const ScheduledRules& rules, std::uint64_t seed, Ended ended);

  /// Returns its number, from 0 on. `name`: of its random stream.
  std::size_t add(const std::string& name, const CellUser& kind = {});
  void set_urgency(Urgency urgency) { urgency_ = std::move(urgency); }
  void set_value(Value value) { value_ = std::move(value); }

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
    std::int64_t replaced = 0;
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
    bool is_news = true;  ///< nothing of its message was lost
  };
  using Message = std::pair<std::uint64_t, Instant>;  ///< ids, when it was pushed
  struct User {
    Duration phase;
    CellUser kind;
    RandomEngine random;
    std::deque<Packet> packets = {};
    /// When the newest message that was delivered was pushed; without age, when that was.
    std::optional<Instant> newest_delivered = std::nullopt;
    std::optional<Message> begun = std::nullopt;  ///< the last one of which something was sent
  };

  Instant slot_at_or_after(Instant t) const;
  Instant next_request(const User& user, Instant now) const;
  Message message_of(const Packet& packet) const {
    return {packet.id / rules_.ids_of_a_message, packet.since};
  }
  std::size_t choose(Instant now) const;
  double urgency_of(std::size_t user, Instant now) const;
  std::optional<Instant> replace(User& user, const Message& by);
  void lose_part_of(User& user, const Message& message) const;
  void transmit(Instant start);

  ScheduledRules rules_;
  std::uint64_t seed_;
  Ended ended_;
  Urgency urgency_;
  Value value_;
  std::vector<User> users_;
  std::size_t last_ = 0;        ///< served
  Instant free_from_ = kStart;  ///< the cell
  Counters counters_;
};

}  // namespace tether
