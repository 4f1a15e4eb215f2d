#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "link/peer/peer_link.hpp"

namespace tether::link {

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
  /// nullptr, and counted: there is none, or it is not there.
  Peer* sender(std::size_t number, std::size_t path, const Address& from, std::int64_t& unknown);
  Peer* named_by(std::uint64_t key_id, std::size_t path, const Address& from);

  Output out_;
  Refusals refused_;
  std::deque<Peer> peers_;
  std::size_t path_ = 0;  // path of the datagram in progress
  Address from_;
};

}  // namespace tether::link
