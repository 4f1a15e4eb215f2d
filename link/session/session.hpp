#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "common/base/time.hpp"
#include "link/session/handshake.hpp"
#include "link/session/replay_window.hpp"

namespace tether::link {

/// Result of opening a sealed datagram.
enum class Opened : std::uint8_t {
  fresh,      ///< authentic, and the first of its counter
  duplicate,  ///< authentic, and known from another path
  replayed,   ///< came by this path before, or is older than its window
  late,       ///< authentic, but older than what the other paths' window remembers
  forged      ///< not the peer's, or changed on the way
};

/// A session in force: seals with ChaCha20-Poly1305 (RFC 8439) and a counter as nonce, and opens
/// each counter once. Keys are wiped at the end.
class Session {
 public:
  /// `initiated`: by us.
  Session(const SessionKeys& keys, bool initiated, Instant begin);
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  /// Replaces what is in `datagram`. Returns its counter.
  std::uint64_t seal(ByteView text, Bytes& datagram);
  std::uint64_t next_counter() const { return counter_; }

  /// `text` is what was sealed, if it is fresh; else it is not to be used. A datagram that does not
  /// authenticate changes nothing.
  Opened open(std::size_t path, const SealedHeader& header, ByteView datagram, Bytes& text);

  /// Whether the peer sealed it, be it known or not. Changes nothing.
  bool is_authentic(const SealedHeader& header, ByteView datagram) const;

  /// Replay window of the opened datagrams, on all paths.
  const ReplayWindow& window() const { return window_; }
  std::uint32_t own_number() const { return keys_.own_session; }
  /// When the peer's first datagram in it came, among the sessions with it: 1, 2 …; 0 before that.
  std::uint64_t generation() const { return generation_; }
  void begin_generation(std::uint64_t generation) { generation_ = generation; }
  bool initiated() const { return initiated_; }
  Instant begin() const { return begin_; }

  /// Counters of both ends on a path in this session, and those last sent.
  struct PathCount {
    std::uint64_t sent = 0;
    std::uint64_t received = 0;  ///< authentic ones, each counter once
    std::uint64_t told = 0;      ///< the peer has sent so many, by its last PROBE
    std::uint64_t received_by_then = 0;
  };
  PathCount& count(std::size_t path) { return counts_[path]; }

 private:
  SessionKeys keys_;
  std::uint64_t generation_ = 0;
  bool initiated_;
  Instant begin_;
  std::uint64_t counter_ = 0;
  ReplayWindow window_;
  std::array<ReplayWindow, kMostPaths> path_windows_;
  std::array<PathCount, kMostPaths> counts_{};
};

}  // namespace tether::link
