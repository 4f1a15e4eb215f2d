#include "link/peer/endpoint.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <utility>

#include "common/base/errors.hpp"

namespace tether::link {

Endpoint::Endpoint(const KeyPair& own, const std::vector<PeerSetup>& peers,
                   const LinkSettings& settings, Output out, const RandomKey& random)
    : out_(std::move(out)) {
  assert(peers.size() <= kMostPeers && settings.paths >= 1 && settings.paths <= kMostPaths);
  for (const PeerSetup& setup : peers) {
    const std::size_t number = peers_.size();
    std::vector<Place> places(settings.paths);
    for (std::size_t path = 0; path < std::min(settings.paths, setup.addresses.size()); ++path) {
      places[path].address = setup.addresses[path];
      places[path].is_pinned = setup.addresses[path].has_value();
    }
    const std::uint64_t id = key_id(setup.key);
    if (std::any_of(peers_.begin(), peers_.end(), [id](const Peer& p) { return p.key_id == id; })) {
      throw UsageError(fmt::format("two peers have the public key {}", key_text(setup.key)));
    }
    peers_.push_back({id, std::move(places),
                      PeerLink(Identity(own, setup.key), static_cast<std::uint8_t>(number),
                               setup.rules, settings, output_of(number), random, refused_)});
  }
}

PeerOutput Endpoint::output_of(std::size_t number) {
  return {[this, number](std::size_t path, ByteView datagram) {
            const std::optional<Address>& to = peers_[number].places[path].address;
            if (to) out_.send(path, *to, datagram);
            return to.has_value();
          },
          [this](ByteView datagram) { out_.send(path_, from_, datagram); },
          [this, number](std::string_view channel, ByteView bytes) {
            out_.deliver(number, channel, bytes);
          }};
}

Endpoint::Peer* Endpoint::sender(std::size_t number, std::size_t path, const Address& from,
                                 std::int64_t& unknown) {
  if (number >= peers_.size()) {
    ++unknown;
    return nullptr;
  }
  Peer& peer = peers_[number];
  if (peer.places[path].is_pinned && peer.places[path].address != from) {
    ++refused_.address;
    return nullptr;
  }
  return &peer;
}

Endpoint::Peer* Endpoint::named_by(std::uint64_t key_id, std::size_t path, const Address& from) {
  const auto found = std::find_if(peers_.begin(), peers_.end(),
                                  [key_id](const Peer& p) { return p.key_id == key_id; });
  return sender(static_cast<std::size_t>(found - peers_.begin()), path, from, refused_.unknown_key);
}

void Endpoint::take(std::size_t path, const Address& from, ByteView datagram, Moment m) {
  path_ = path;
  from_ = from;
  if (!datagram.empty() && datagram[0] != kVersion) {
    ++refused_.version;
  } else if (const auto sealed = read_sealed_header(datagram)) {
    Peer* const peer = sender(sealed->session & 0xFF, path, from, refused_.no_session);
    if (peer != nullptr) {
      learn(*peer, path, from, peer->link.on_sealed(path, *sealed, datagram, m), m);
    }
  } else if (const auto hello = read_hello(datagram)) {
    Peer* const peer = named_by(hello->key_id, path, from);
    if (peer != nullptr) peer->link.on_hello(datagram, m);
  } else if (const auto answer = read_answer(datagram)) {
    Peer* const peer = sender(answer->to_session & 0xFF, path, from, refused_.no_session);
    if (peer != nullptr) peer->link.on_answer(datagram, m);
  } else {
    ++refused_.malformed;
  }
}

void Endpoint::learn(Peer& peer, std::size_t path, const Address& from, const Whereabouts& where,
                     Moment m) {
  Place& place = peer.places[path];
  if (!where.authentic || place.is_pinned) return;
  if (place.address == from) {
    place.heard = m.now;
    return;
  }
  if (!where.newest || (place.address && m.now - place.heard < kSilentPlace)) return;
  const bool answers = place.candidate == from && where.echo_wall_ns == place.challenge_ns;
  if (!place.address || answers) {
    place = {.address = from, .heard = m.now};
  } else if (place.candidate != from || m.now - place.challenged >= kChallengeLife) {
    place.candidate = from;
    place.challenge_ns = m.wall_ns;
    place.challenged = m.now;
    peer.link.challenge(path, m);
  }
}

void Endpoint::send(std::string_view channel, ByteView bytes, Moment m) {
  for (Peer& peer : peers_) peer.link.send(channel, bytes, m);
}

void Endpoint::flush(Moment m) {
  for (Peer& peer : peers_) peer.link.flush(m);
}

void Endpoint::tick(Moment m) {
  for (Peer& peer : peers_) peer.link.tick(m);
}

void Endpoint::send_copies(Instant now) {
  for (Peer& peer : peers_) peer.link.send_copies(now);
}

}  // namespace tether::link
