#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "common/base/time.hpp"
#include "link/session/handshake.hpp"
#include "link/session/refusals.hpp"
#include "link/session/session.hpp"

namespace tether::link {

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
/// HELLOs are taken only if their time is within kMostClockDifference of ours, and later than that
/// of the newest one taken: recorded ones do not displace it. A peer whose clock is set back has to
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

  /// To seal with; nullptr: there is none.
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
