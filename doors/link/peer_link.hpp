#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/pattern.hpp"
#include "doors/link/clock_offset.hpp"
#include "doors/link/path_fates.hpp"
#include "doors/link/path_statistics.hpp"
#include "doors/link/pieces.hpp"
#include "doors/link/sessions.hpp"

namespace tether::link {

/// Which channels go to a peer, and under which names: rules
///
///     REGEX            as they are
///     REGEX -> RENAME  (or →) $1 … for what the groups matched, $& for all
///
/// whose REGEX (common/base/pattern.hpp) must match a channel's whole name. The first that does
/// counts.
class SendRules {
 public:
  SendRules() = default;
  /// Throws UsageError that quotes the rule.
  explicit SendRules(const std::vector<std::string>& rules);

  /// The name at the peer; nullopt: this channel stays here.
  std::optional<std::string> name_of(std::string_view channel) const;

 private:
  struct Rule {
    Pattern pattern;
    std::string rename;
  };
  std::vector<Rule> rules_;
};

/// A list of channels: those whose whole name one of its patterns matches.
class ChannelList {
 public:
  ChannelList() = default;
  /// Throws UsageError that quotes the pattern.
  explicit ChannelList(const std::vector<std::string>& patterns);

  bool has(std::string_view channel) const;

 private:
  std::vector<Pattern> patterns_;
};

/// Settings that all peers of a host share.
struct LinkSettings {
  std::size_t paths = 1;              ///< up to kMostPaths
  std::size_t datagram_bytes = 1372;  ///< at most, UDP's payload; at least kSmallestDatagram
  /// When the second path gets its copy of a message: at once; or only if the peer has not
  /// acknowledged the first within this time.
  std::optional<Duration> second_after;
  Duration probe_period = std::chrono::milliseconds{250};
  /// Difference of the clocks from which on messages for a time are not taken.
  Duration clock_limit = std::chrono::milliseconds{200};
  RekeySettings rekey;
};

/// Permissions of one peer.
struct PeerRules {
  SendRules send;       ///< rules for messages to it
  ChannelList receive;  ///< channels accepted from it, under the names that it sends; not LINK/…
  ChannelList timed;    ///< the timed ones of these: not accepted while the clocks differ
  ChannelList latest_only;  ///< on these channels, by the names on the way, a new message replaces
                            ///< the old one
};

/// Interface to everything that a PeerLink acts upon.
struct PeerOutput {
  /// False: it is not known where the peer is on this path.
  std::function<bool(std::size_t path, ByteView datagram)> send;
  /// To where the datagram that is being taken came from.
  std::function<void(ByteView datagram)> reply;
  std::function<void(std::string_view channel, ByteView bytes)> deliver;
};

struct PeerCounters {
  std::int64_t sent = 0;           ///< messages
  std::int64_t delivered = 0;      ///< messages, each once
  std::int64_t unsent = 0;         ///< messages without a session, or too long
  std::int64_t not_allowed = 0;    ///< messages of channels that this peer may not send
  std::int64_t clock_refused = 0;  ///< messages for a time, while the clocks are too far apart
  std::int64_t superseded = 0;     ///< latest-only messages that came after a newer one
  std::int64_t duplicates = 0;     ///< datagrams that came by both paths
  std::int64_t copies = 0;         ///< deferred copies sent
  std::int64_t copies_saved = 0;   ///< deferred copies that were acknowledged or superseded in time
};

/// The sender's counters on a path, in a sealed datagram.
struct Whereabouts {
  bool authentic = false;         ///< the peer sealed it, be it a copy of one that came before
  bool newest = false;            ///< a PROBE of that path, and the newest
  std::int64_t echo_wall_ns = 0;  ///< time of our PROBE that the peer's PROBE answers
};

/// One peer: messages in, datagrams out, and back. Pure: time and randomness are arguments.
///
/// Each datagram goes by every path under one counter, and the first copy counts. PROBEs go by each
/// path, each period; they also keep a path open through NAT, and notice when it is down. One of
/// kLongProbe is as long as datagrams may be, and notices a network that drops such.
class PeerLink {
 public:
  static constexpr std::uint64_t kLongProbe = 4;

  /// `refused` must outlive it. `number`: below 256, of this peer alone.
  PeerLink(const Identity& identity, std::uint8_t number, PeerRules rules,
           const LinkSettings& settings, PeerOutput out, RandomKey random, Refusals& refused);

  /// Sends a message of the host's, if a rule is about its channel.
  void send(std::string_view channel, ByteView bytes, Moment m);

  // Each takes a datagram, which lives as long as the call.
  void on_hello(ByteView hello, Moment m);
  void on_answer(ByteView answer, Moment m);
  Whereabouts on_sealed(std::size_t path, const SealedHeader& header, ByteView datagram, Moment m);
  /// Sends a PROBE of this path to where the datagram that is being taken came from.
  void challenge(std::size_t path, Moment m);

  /// After a batch of datagrams: acknowledges them.
  void flush(Moment m);
  /// Often, every 10 ms say: handshakes, probes.
  void tick(Moment m);
  /// Sends deferred copies whose time has come; second_after after a message, and with tick().
  void send_copies(Instant now);

  bool up(Instant now) const;
  bool alive(std::size_t path, Instant now) const { return paths_[path].alive(now); }
  /// Whether its PROBEs come by it, not by the other one.
  bool is_crossed(std::size_t path, Instant now) const { return paths_[path].is_crossed(now); }
  /// Whether the peer's longest datagrams come by it, too.
  bool carries_long(std::size_t path) const { return paths_[path].carries_long(); }
  /// Since the newest authentic datagram; −1 s before the first.
  double age_s(Instant now) const { return newest_ ? to_seconds(now - *newest_) : -1.0; }
  PathReport report(std::size_t path, Instant now) { return paths_[path].report(now); }
  /// Fates of the peer's datagrams on that path that have become known since the last call.
  std::vector<Fate> take_fates(std::size_t path) { return fates_.take(path); }
  const LossBursts& bursts(std::size_t path) const { return fates_.bursts(path); }
  std::optional<IntervalNs> offset(Instant now) const { return offset_.at(now); }
  std::int64_t clock_steps() const { return offset_.steps(); }
  std::int64_t incomplete() const { return reassembly_.incomplete(); }
  const PeerCounters& counters() const { return counters_; }
  const Sessions& sessions() const { return sessions_; }

 private:
  /// A message that waits for its acknowledgement.
  struct Copy {
    Instant due;
    std::uint32_t session;
    std::uint64_t counter;
    std::size_t path;
    std::string channel;  // if latest-only
    Bytes datagram;
  };
  struct LastProbe {
    std::int64_t wall_ns = 0;
    std::int64_t arrival_ns = 0;
  };

  void send_piece(Session& session, const Piece& piece, const std::string& latest, Moment m);
  void send_by(std::size_t path, Session& session, ByteView datagram);
  void probe(std::size_t path, Moment m);
  void probe_all(Moment m);
  void defer(const std::string& latest, std::uint32_t session, std::uint64_t counter,
             std::size_t path, Instant due);
  /// Seals a PROBE into datagram_; nullptr: there is no session.
  Session* seal_probe(std::size_t path, Moment m);
  /// Whether it is the newest of its path.
  bool on_probe(std::size_t path, Session& session, std::int64_t wall_ns, const Probe& probe,
                Moment m);
  void judge(std::size_t path, const Session& session, std::uint64_t counter, const Text& text,
             Moment m);
  void on_piece(std::size_t path, const Session& session, std::uint64_t counter, const Piece& piece,
                Moment m);
  void on_ack(const Session& session, const Ack& ack);
  void deliver(const Reassembly::Whole& whole, Instant now);

  PeerRules rules_;
  LinkSettings settings_;
  PeerOutput out_;
  Refusals& refused_;
  Sessions sessions_;
  std::array<PathStatistics, kMostPaths> paths_;
  std::array<LastProbe, kMostPaths> last_probes_{};
  PathFates fates_;
  ClockOffset offset_;
  Reassembly reassembly_;
  // Newest message of each latest-only channel.
  std::map<std::string, MessageNumber, std::less<>> newest_of_;
  std::deque<Copy> copies_;
  std::optional<std::uint32_t> to_acknowledge_;  // session
  std::size_t acknowledge_by_ = 0;
  std::optional<Instant> newest_;
  std::optional<Instant> next_probe_;
  std::uint64_t probes_ = 0;  // periods
  PeerCounters counters_;
  Bytes text_;
  Bytes datagram_;
  Bytes opened_;
};

/// IPv4, as numbers of this host's order.
struct Address {
  std::uint32_t ip = 0;
  std::uint16_t port = 0;
  bool operator==(const Address&) const = default;
};

/// One peer as a configuration has it.
struct PeerSetup {
  Key key{};
  PeerRules rules;
  /// By path; what is empty, or none, is learned (Endpoint).
  std::vector<std::optional<Address>> addresses;
};

/// All peers of a host: finds whose a datagram is.
///
/// A datagram that does not authenticate changes a counter, and nothing else. Only an authentic
/// HELLO is answered, to where it came from, by one shorter datagram.
///
/// An address that is not configured is learned from the first authentic PROBE of that path. It
/// changes only after nothing authentic has come from it for kSilentPlace, and after the new place
/// has answered a PROBE that was sent there (as QUIC validates paths): who forwards copies of the
/// peer's datagrams, however fast, does not get what is sent to the peer.
class Endpoint {
 public:
  static constexpr std::size_t kMostPeers = 256;
  static constexpr Duration kSilentPlace = std::chrono::seconds{1};
  static constexpr Duration kChallengeLife = std::chrono::milliseconds{500};

  struct Output {
    std::function<void(std::size_t path, const Address& to, ByteView datagram)> send;
    std::function<void(std::size_t peer, std::string_view channel, ByteView bytes)> deliver;
  };

  /// Throws UsageError for keys that cannot be a peer's, or are two peers'.
  Endpoint(const KeyPair& own, const std::vector<PeerSetup>& peers, const LinkSettings& settings,
           Output out, const RandomKey& random);
  Endpoint(const Endpoint&) = delete;
  Endpoint& operator=(const Endpoint&) = delete;

  /// A datagram that came by a path. `m`: of its arrival.
  void take(std::size_t path, const Address& from, ByteView datagram, Moment m);
  /// A message of this host's, for whichever peers have a rule for its channel.
  void send(std::string_view channel, ByteView bytes, Moment m);

  // To all peers, as PeerLink has them.
  void flush(Moment m);
  void tick(Moment m);
  void send_copies(Instant now);

  std::size_t size() const { return peers_.size(); }
  PeerLink& peer(std::size_t number) { return peers_[number].link; }
  const Refusals& refused() const { return refused_; }

 private:
  /// Where a peer is on a path.
  struct Place {
    std::optional<Address> address;
    bool is_pinned = false;  ///< by the configuration
    Instant heard{};         ///< something authentic from there, be it a copy
    std::optional<Address> candidate = {};
    std::int64_t challenge_ns = 0;  ///< time of the PROBE that was sent to the candidate, …
    Instant challenged{};           ///< … on the loop's clock
  };
  struct Peer {
    std::uint64_t key_id;
    std::vector<Place> places;
    PeerLink link;
  };
  void learn(Peer& peer, std::size_t path, const Address& from, const Whereabouts& where, Moment m);

  PeerOutput output_of(std::size_t number);
  /// nullptr, which is counted, if no peer has this number or it is at another address.
  Peer* sender(std::size_t number, std::size_t path, const Address& from, std::int64_t& unknown);
  Peer* named_by(std::uint64_t key_id, std::size_t path, const Address& from);

  Output out_;
  Refusals refused_;
  std::deque<Peer> peers_;
  std::size_t path_ = 0;  // path of the datagram in progress
  Address from_;
};

}  // namespace tether::link
