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
    std::vector<std::optional<Address>> addresses = setup.addresses;
    addresses.resize(settings.paths);
    const std::uint64_t id = key_id(setup.key);
    if (std::any_of(peers_.begin(), peers_.end(), [id](const Peer& p) { return p.key_id == id; })) {
      throw UsageError(fmt::format("two peers have the public key {}", key_text(setup.key)));
    }
    peers_.push_back({id, addresses, addresses,
                      PeerLink(Identity(own, setup.key), static_cast<std::uint8_t>(number),
                               setup.rules, settings, output_of(number), random, refused_)});
  }
}

PeerOutput Endpoint::output_of(std::size_t number) {
  return {[this, number](std::size_t path, ByteView datagram) {
            const std::optional<Address>& to = peers_[number].current[path];
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
  if (peer.pinned[path] && *peer.pinned[path] != from) {
    ++refused_.address;
    return nullptr;
  }
  return &peer;
}

Endpoint::Peer* Endpoint::named_by(std::uint64_t key_id, std::size_t path, const Address& from) {
  const auto found = std::find_if(peers_.begin(), peers_.end(),
                                  [key_id](const Peer& p) { return p.key_id == key_id; });
  return sender(static_cast<std::size_t>(found - peers_.begin()), path, from, refused_.stranger);
}

void Endpoint::take(std::size_t path, const Address& from, ByteView datagram, Moment m) {
  path_ = path;
  from_ = from;
  if (!datagram.empty() && datagram[0] != kVersion) {
    ++refused_.version;
  } else if (const auto sealed = read_sealed_header(datagram)) {
    Peer* const peer = sender(sealed->session & 0xFF, path, from, refused_.no_session);
    if (peer != nullptr && peer->link.on_sealed(path, *sealed, datagram, m)) {
      peer->current[path] = from;
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
