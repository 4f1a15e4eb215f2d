#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "common/base/counters.hpp"
#include "common/base/time.hpp"
#include "doors/link/handshake.hpp"

namespace tether::link {

/// Which counters have been seen, of the newest kSize (RFC 4303, 3.4.3; RFC 6479's ring of words).
class ReplayWindow {
 public:
  static constexpr std::uint64_t kSize = 2048;
  enum class Verdict : std::uint8_t { fresh, seen, too_old };

  Verdict look(std::uint64_t counter) const;
  /// Only of an authentic datagram: a forged counter would push all others out. Too old ones change
  /// nothing.
  void mark(std::uint64_t counter);

  /// Whether any has been marked, and the newest of them.
  bool any() const { return any_; }
  std::uint64_t newest() const { return newest_; }
  /// Bit i: newest() − i was marked.
  std::uint64_t newest_bits() const;

 private:
  static constexpr std::uint64_t kWordBits = 64;
  // One word more than the window, which is not aligned to words.
  static constexpr std::uint64_t kWords = kSize / kWordBits + 1;

  bool is_marked(std::uint64_t counter) const;

  std::array<std::uint64_t, kWords> words_{};
  std::uint64_t newest_ = 0;
  bool any_ = false;
};

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

/// Datagrams that were not taken, by reason. Nothing else of them is kept or said anywhere.
struct Refusals {
  std::int64_t malformed = 0;    ///< no datagram of this protocol
  std::int64_t version = 0;      ///< another version of this protocol
  std::int64_t unknown_key = 0;  ///< a HELLO of a key that the configuration does not name
  std::int64_t address = 0;      ///< not from where this peer is
  std::int64_t no_session = 0;   ///< names a session that does not exist (any more)
  std::int64_t forged = 0;       ///< does not authenticate: forged, changed, reflected
  std::int64_t replayed = 0;     ///< came before, by the same path
  std::int64_t late = 0;         ///< authentic, but behind the replay window
  std::int64_t clock = 0;        ///< an authentic HELLO of a time too far from ours, or an old one
  std::int64_t crossed = 0;      ///< an authentic PROBE of another path: paths are not in one order

  std::int64_t sum() const {
    return malformed + version + unknown_key + address + no_session + forged + replayed + late +
           clock + crossed;
  }
  void list(CounterList& out) const {
    out.insert(out.end(), {{"malformed", malformed},
                           {"version", version},
                           {"stranger", unknown_key},
                           {"address", address},
                           {"no_session", no_session},
                           {"forged", forged},
                           {"replayed", replayed},
                           {"late", late},
                           {"clock", clock},
                           {"crossed", crossed}});
  }
};

/// Now, on the loop's clock and on the wall clock (ns since 1970).
struct Moment {
  Instant now;
  std::int64_t wall_ns = 0;
};

/// 32 unpredictable bytes, different in each call: libsodium's randombytes in programs.
using RandomKey = std::function<Key()>;

/// When sessions end.
struct RekeySettings {
  Duration after = std::chrono::hours{1};
  std::uint64_t datagrams = std::uint64_t{1} << 40;
};

/// The sessions with one peer: opens them, answers, renews keys, ends them.
///
/// Either side may begin, both at once too: then the session counts that the side with the smaller
/// public key began, for both. A session that was only answered takes over with its first authentic
/// datagram; the one before is heard for kPreviousLife after its last datagram. So renewing keys
/// loses nothing, and a replayed HELLO, at worst, makes an answer that leads nowhere. Where losses
/// leave each side with another session, both are heard, and new keys end it: the side with the
/// larger public key begins after kDisagreement of hearing only the one before, the other after
/// three times that.
///
/// A HELLO is accepted only if its time is within kMostClockDifference of ours and later than the
/// last accepted HELLO's. So recorded ones are refused. A peer whose clock is set back has to
/// wait for that long at most before it can begin a session. Each is answered by one datagram,
/// which is shorter; one that came by another path, by the same.
class Sessions {
 public:
  static constexpr Duration kMostClockDifference = std::chrono::seconds{60};
  static constexpr Duration kAnsweredLife = std::chrono::seconds{10};
  static constexpr Duration kPreviousLife = std::chrono::seconds{10};
  static constexpr Duration kDisagreement = std::chrono::seconds{1};
  static constexpr Duration kFirstWait = std::chrono::milliseconds{500};  // then twice as long …
  static constexpr Duration kLongestWait = std::chrono::seconds{4};
  /// To one HELLO, which may come by each path.
  static constexpr std::size_t kMostAnswers = kMostPaths;

  /// `number`: of this peer among the host's, below 256; session numbers hold it in their last
  /// byte. `refused` must outlive it.
  Sessions(const Identity& identity, std::uint8_t number, const RekeySettings& rekey,
           RandomKey random, Refusals& refused);

  /// The datagram to send back to where the HELLO came from, if it is to be answered.
  std::optional<ByteView> on_hello(ByteView hello, Moment m);
  /// Whether there is a new session now.
  bool on_answer(ByteView answer, Moment m);
  /// The session of a sealed datagram; nullptr: none.
  Session* find(std::uint32_t number);
  /// An authentic datagram of `session` came. Whether it took over by that.
  bool confirm(Session& session, Instant now);

  /// The session that seals what is sent; nullptr if there is none.
  Session* current() { return current_.get(); }
  /// Ends what is too old. `wanted`: begins a session even if one is valid. The HELLO to send by
  /// all paths, if it is time for one.
  std::optional<ByteView> due_hello(Moment m, bool wanted);

  /// Completed handshakes.
  std::int64_t count() const { return count_; }
  /// Lead of the peer's clock over this host's in the last HELLO that was refused for that.
  std::int64_t clock_ahead_ns() const { return clock_ahead_ns_; }

 private:
  struct Started {
    KeyPair ephemeral;
    std::uint32_t number;
    Bytes hello;
  };
  struct Taken {
    std::int64_t wall_ns;
    Instant when;
  };

  std::uint32_t new_number();
  KeyPair new_pair();
  /// False: it is not newer than the newest one.
  bool take(const Hello& hello, Instant now);
  void install(std::unique_ptr<Session> session, Instant now);
  bool wants_new_keys(Instant now) const;

  Identity identity_;
  std::uint8_t number_;
  RekeySettings rekey_;
  RandomKey random_;
  Refusals& refused_;

  std::unique_ptr<Session> current_;
  std::unique_ptr<Session> previous_;
  Instant previous_end_;
  Instant current_heard_;              // or since it took over
  bool disagree_ = false;              // the peer seals in previous_
  std::unique_ptr<Session> answered_;  // not confirmed yet
  Mac answered_hello_{};
  std::size_t answers_ = 0;  // to that HELLO
  Bytes answer_;
  std::optional<Started> started_;
  std::optional<Instant> next_hello_;
  Duration wait_ = kFirstWait;
  std::optional<Taken> newest_hello_;
  std::uint64_t generations_ = 0;
  std::int64_t count_ = 0;
  std::int64_t clock_ahead_ns_ = 0;
};

}  // namespace tether::link
