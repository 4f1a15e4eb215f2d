#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "common/base/time.hpp"
#include "doors/link/wire.hpp"

namespace tether::link {

/// Fate of one of the peer's datagrams on a path.
struct Fate {
  std::int64_t sent_ns = 0;  ///< by the peer's clock; of one that no path brought, interpolated
  /// Arrival by our clock minus sending by the peer's: delay − offset. nullopt: lost.
  std::optional<std::int64_t> transit_ns;
  bool after_gap = false;  ///< the number of datagrams sent since the previous fate is unknown
};

/// Runs of lost datagrams that have ended, since the start.
struct LossBursts {
  std::int64_t count = 0;
  std::int64_t lost = 0;  ///< datagrams in them
  std::int64_t longest = 0;
};

/// Which of the peer's datagrams each path lost, in the order of their counters.
///
/// All paths share the counters of a session. A PIECE goes by every path, an ACK by one, a PROBE by
/// its own, under counters in a row (doors/link/wire.hpp). So a missing counter was lost on a path,
/// unless a PROBE next to it says that it was another path's. Between two PROBEs the number of lost
/// ones is exact, since they say how many were sent; only if the PROBEs of all paths are lost at
/// once, or an ACK, it is a guess which counter, within that quarter of a second, was not sent.
///
/// A fate is known kPatience after the PROBE that follows; what comes later counts as lost. Of a
/// path that has fallen silent, all counters that others bring are lost. Of a peer that defers
/// copies there are no fates: which path it chose is not known.
class PathFates {
 public:
  static constexpr Duration kPatience = std::chrono::seconds{1};
  /// Counters that are not settled yet. Of more than that, nothing is known.
  static constexpr std::size_t kMostOpen = std::size_t{1} << 18;
  /// Maximum number of fates of a path until take().
  static constexpr std::size_t kMostFates = std::size_t{1} << 18;

  explicit PathFates(std::size_t paths) : count_(paths) {}

  /// An authentic datagram that this path had not brought. Those of a session before are ignored.
  /// `own`: it is an ACK or a PROBE, which no other path carries.
  void on_received(std::size_t path, std::uint64_t generation, std::uint64_t counter,
                   std::int64_t sent_ns, std::int64_t transit_ns, bool own);
  /// The same was a PROBE: the peer has sent so many by that path in this session.
  void on_probe(Instant now, std::size_t path, std::uint64_t generation, std::uint64_t counter,
                std::uint64_t sent);
  /// In this session the peer defers copies.
  void on_deferred(std::uint64_t generation);

  /// The fates that have become known since the last call.
  std::vector<Fate> take(std::size_t path);
  const LossBursts& bursts(std::size_t path) const { return paths_[path].bursts; }

 private:
  struct Entry {
    std::int64_t sent_ns = 0;
    std::array<std::int64_t, kMostPaths> transit_ns{};
    std::uint8_t brought = 0;  // a bit for each path
    std::int8_t only = -1;     // the path that alone carries it, if known
  };
  /// The peer has sent `sent` by a path, up to and with this counter.
  struct Mark {
    Instant when;
    std::uint64_t counter = 0;
    std::uint64_t sent = 0;
  };
  struct Path {
    std::uint64_t settled = 0;  // counters below
    std::uint64_t sent = 0;     // datagrams below `settled` that went by this path
    std::int64_t last_sent_ns = 0;
    std::deque<Mark> marks;  // PROBEs not settled yet
    Instant heard;           // the latest PROBE
    bool ever_heard = false;
    bool uncounted = false;  // how many were sent before is not known: the next PROBE says it
    bool after_gap = true;
    std::int64_t run = 0;  // lost at the end of what is settled
    std::vector<Fate> fates;
    LossBursts bursts;
  };

  /// Its counters wait to be settled.
  static bool follows(const Path& path) { return path.ever_heard && !path.uncounted; }
  void begin(std::uint64_t generation, std::uint64_t counter);
  Entry* entry(std::uint64_t counter);
  void settle_marks(std::size_t path, Instant now);
  /// Settles the fates of a path that has become silent, from what other paths report as sent.
  void settle_silent(std::size_t path, Instant now);
  void settle(std::size_t path, std::uint64_t end, std::optional<std::uint64_t> sent);
  /// No path brought it, nor is it known to be of one alone.
  bool unseen(std::uint64_t counter) const;
  std::vector<std::uint64_t> missing(std::size_t path, std::uint64_t end,
                                     std::uint64_t& received) const;
  void add(Path& path, Fate fate);
  void forget_settled();

  std::size_t count_;
  std::uint64_t generation_ = 0;
  bool deferred_ = false;
  std::uint64_t base_ = 0;  // number of the first of entries_
  std::deque<Entry> entries_;
  std::array<Path, kMostPaths> paths_;
};

}  // namespace tether::link
