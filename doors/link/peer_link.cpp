#include "doors/link/peer_link.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"

namespace tether::link {

SendRules::SendRules(const std::vector<std::string>& rules) {
  for (const std::string& rule : rules) {
    try {
      const auto [pattern, rename] =
          split_at_arrow(rule).value_or(std::pair{std::string(trimmed(rule)), std::string("$&")});
      if (pattern.empty()) throw UsageError("no pattern of channels");
      if (rename.empty()) throw UsageError("nothing behind the arrow");
      rules_.push_back({Pattern(pattern), rename});
      rules_.back().pattern.check_replacement(rename);
    } catch (const UsageError& error) {
      throw UsageError(fmt::format("\"{}\": {} (such as \"CTRL/(CMD_VEL|PLAN) -> AGV/$1\")", rule,
                                   error.what()));
    }
  }
}

std::optional<std::string> SendRules::name_of(std::string_view channel) const {
  for (const Rule& rule : rules_) {
    if (auto name = rule.pattern.replaced(channel, rule.rename)) return name;
  }
  return std::nullopt;
}

ChannelList::ChannelList(const std::vector<std::string>& patterns)
    : patterns_(patterns.begin(), patterns.end()) {}

bool ChannelList::has(std::string_view channel) const {
  return std::any_of(patterns_.begin(), patterns_.end(),
                     [channel](const Pattern& p) { return p.matches(channel); });
}

namespace {

/// Reports on the host itself neither leave nor come.
constexpr std::string_view kOwnChannels = "LINK/";
/// Without a datagram for this long, the peer may have forgotten the session.
constexpr Duration kSilence = std::chrono::seconds{3};
constexpr std::size_t kMostCopies = 4096;
constexpr std::size_t kMostLatestChannels = 1000;
/// More between two PROBES is no honest peer's count.
constexpr std::uint64_t kMostTold = std::uint64_t{1} << 40;

}  // namespace

PeerLink::PeerLink(const Identity& identity, std::uint8_t number, PeerRules rules,
                   const LinkSettings& settings, PeerOutput out, RandomKey random,
                   Refusals& refused)
    : rules_(std::move(rules)),
      settings_(settings),
      out_(std::move(out)),
      refused_(refused),
      sessions_(identity, number, settings.rekey, std::move(random), refused),
      fates_(settings.paths) {}

bool PeerLink::up(Instant now) const {
  return std::any_of(paths_.begin(), paths_.begin() + static_cast<long>(settings_.paths),
                     [now](const PathStatistics& p) { return p.alive(now); });
}

// --- Out

void PeerLink::send(std::string_view channel, ByteView bytes, Moment m) {
  const std::optional<std::string> name = rules_.send.name_of(channel);
  if (!name || channel.starts_with(kOwnChannels)) return;
  Session* const session = sessions_.current();
  if (session == nullptr) {
    ++counters_.unsent;
    return;
  }
  const bool latest = rules_.latest_only.has(*name);
  if (latest) {
    counters_.copies_saved += static_cast<std::int64_t>(
        std::erase_if(copies_, [&](const Copy& copy) { return copy.channel == *name; }));
  }
  const std::size_t pieces = cut(*name, bytes, settings_.datagram_bytes, [&](const Piece& piece) {
    send_piece(*session, piece, latest ? *name : std::string{}, m);
  });
  ++(pieces > 0 ? counters_.sent : counters_.unsent);
}

void PeerLink::send_by(std::size_t path, Session& session, ByteView datagram) {
  if (!out_.send(path, datagram)) return;
  ++session.count(path).sent;
  paths_[path].on_sent();
}

void PeerLink::send_piece(Session& session, const Piece& piece, const std::string& latest,
                          Moment m) {
  const bool first_alive = paths_[0].alive(m.now);
  const bool deferred =
      settings_.second_after && settings_.paths > 1 && (first_alive || paths_[1].alive(m.now));
  Piece asking = piece;
  asking.wants_ack = deferred;
  write_text(text_, {m.wall_ns, asking});
  const std::uint64_t counter = session.seal(text_, datagram_);
  if (deferred) {
    const std::size_t first = first_alive ? 0 : 1;
    send_by(first, session, datagram_);
    defer(latest, session.own_number(), counter, 1 - first, m.now + *settings_.second_after);
    return;
  }
  for (std::size_t path = 0; path < settings_.paths; ++path) send_by(path, session, datagram_);
}

void PeerLink::defer(const std::string& latest, std::uint32_t session, std::uint64_t counter,
                     std::size_t path, Instant due) {
  if (copies_.size() >= kMostCopies) copies_.pop_front();
  copies_.push_back({due, session, counter, path, latest, datagram_});
}

void PeerLink::send_copies(Instant now) {
  while (!copies_.empty() && copies_.front().due <= now) {
    const Copy copy = std::move(copies_.front());
    copies_.pop_front();
    Session* const session = sessions_.current();
    // With new keys, the receiver's count of the old session is over.
    if (session == nullptr || session->own_number() != copy.session) {
      out_.send(copy.path, copy.datagram);
    } else {
      send_by(copy.path, *session, copy.datagram);
    }
    ++counters_.copies;
  }
}

Session* PeerLink::seal_probe(std::size_t path, Moment m) {
  Session* const session = sessions_.current();
  if (session == nullptr) return nullptr;
  const LastProbe& last = last_probes_[path];
  constexpr std::size_t kBytes = kSealedHeaderBytes + kTagBytes + kProbeBytes;
  const std::size_t padding = probes_ % kLongProbe == 0 ? settings_.datagram_bytes - kBytes : 0;
  write_text(text_,
             {m.wall_ns, Probe{static_cast<std::uint8_t>(path), session->count(path).sent + 1,
                               last.wall_ns, last.arrival_ns, padding}});
  session->seal(text_, datagram_);
  return session;
}

void PeerLink::probe(std::size_t path, Moment m) {
  Session* const session = seal_probe(path, m);
  if (session != nullptr) send_by(path, *session, datagram_);
}

void PeerLink::challenge(std::size_t path, Moment m) {
  Session* const session = seal_probe(path, m);
  if (session == nullptr) return;
  out_.reply(datagram_);
  ++session->count(path).sent;
}

void PeerLink::probe_all(Moment m) {
  ++probes_;
  for (std::size_t path = 0; path < settings_.paths; ++path) probe(path, m);
  next_probe_ = m.now + settings_.probe_period;
}

void PeerLink::flush(Moment m) {
  if (!to_acknowledge_) return;
  const Session* const heard = sessions_.find(*to_acknowledge_);
  Session* const session = sessions_.current();
  to_acknowledge_.reset();
  // Counters are the session's: in another one they would mean others.
  if (heard == nullptr || session != heard) return;
  write_text(text_, {m.wall_ns, Ack{heard->window().newest(), heard->window().newest_bits()}});
  session->seal(text_, datagram_);
  send_by(acknowledge_by_, *session, datagram_);
}

void PeerLink::tick(Moment m) {
  const Session* const session = sessions_.current();
  const bool silent = session != nullptr && m.now - session->begin() > kSilence &&
                      (!newest_ || m.now - *newest_ > kSilence);
  if (const auto hello = sessions_.due_hello(m, silent)) {
    for (std::size_t path = 0; path < settings_.paths; ++path) out_.send(path, *hello);
  }
  if (!next_probe_ || m.now >= *next_probe_) probe_all(m);
  send_copies(m.now);
}

// --- In

void PeerLink::on_hello(ByteView hello, Moment m) {
  if (const auto answer = sessions_.on_hello(hello, m)) out_.reply(*answer);
}

void PeerLink::on_answer(ByteView answer, Moment m) {
  if (sessions_.on_answer(answer, m)) probe_all(m);  // which proves to the peer that we are we
}

Whereabouts PeerLink::on_sealed(std::size_t path, const SealedHeader& header, ByteView datagram,
                                Moment m) {
  Session* const session = sessions_.find(header.session);
  if (session == nullptr) {
    ++refused_.no_session;
    return {};
  }
  const Opened opened = session->open(path, header, datagram, opened_);
  if (opened == Opened::forged) {
    ++refused_.forged;
    return {};
  }
  if (opened == Opened::replayed) {
    ++refused_.replayed;
    return {.authentic = session->is_authentic(header, datagram)};
  }
  const std::optional<Text> text = read_text(opened_);
  const auto* const probe = text ? std::get_if<Probe>(&text->what) : nullptr;
  if (!text || (probe != nullptr && probe->path != path)) {
    ++(text ? refused_.crossed : refused_.malformed);
    if (text) paths_[path].on_crossed(m.now);
    return {};
  }
  if (sessions_.confirm(*session, m.now)) probe_all(m);
  newest_ = m.now;
  paths_[path].on_received(m.now, m.wall_ns - text->wall_ns, opened == Opened::fresh);
  offset_.on_heard(m.now, text->wall_ns, m.wall_ns);
  judge(path, *session, header.counter, *text, m);
  if (opened != Opened::fresh) {
    ++(opened == Opened::late ? refused_.late : counters_.duplicates);
    return {.authentic = true};
  }
  if (const auto* piece = std::get_if<Piece>(&text->what)) {
    on_piece(path, *session, header.counter, *piece, m);
  } else if (probe != nullptr) {
    const bool newest = on_probe(path, *session, text->wall_ns, *probe, m);
    return {true, newest && session == sessions_.current(), probe->echo_wall_ns};
  } else {
    on_ack(*session, std::get<Ack>(text->what));
  }
  return {.authentic = true};
}

void PeerLink::judge(std::size_t path, const Session& session, std::uint64_t counter,
                     const Text& text, Moment m) {
  const std::uint64_t generation = session.generation();
  const auto* const piece = std::get_if<Piece>(&text.what);
  fates_.on_received(path, generation, counter, text.wall_ns, m.wall_ns - text.wall_ns,
                     piece == nullptr);
  if (piece != nullptr && piece->wants_ack) fates_.on_deferred(generation);
  if (const auto* probe = std::get_if<Probe>(&text.what)) {
    fates_.on_probe(m.now, path, generation, counter, probe->sent);
  }
}

bool PeerLink::on_probe(std::size_t path, Session& session, std::int64_t wall_ns,
                        const Probe& probe, Moment m) {
  Session::PathCount& count = session.count(path);
  const std::uint64_t sent = probe.sent - count.told;
  const bool is_newest = probe.sent > count.told && sent < kMostTold;
  if (is_newest) {
    paths_[path].on_told(m.now, static_cast<std::int64_t>(sent),
                         static_cast<std::int64_t>(count.received - count.received_by_then));
    count.told = probe.sent;
    count.received_by_then = count.received;
  }
  last_probes_[path] = {wall_ns, m.wall_ns};
  paths_[path].on_probe(probe.padding > 0);
  if (probe.echo_wall_ns <= 0) return is_newest;
  const std::int64_t away_ns = m.wall_ns - probe.echo_wall_ns;
  paths_[path].on_round_trip(away_ns - (wall_ns - probe.echo_arrival_ns));
  offset_.on_echo(m.now - Duration{std::max<std::int64_t>(away_ns, 0)}, probe.echo_wall_ns,
                  probe.echo_arrival_ns);
  return is_newest;
}

void PeerLink::on_piece(std::size_t path, const Session& session, std::uint64_t counter,
                        const Piece& piece, Moment m) {
  if (piece.wants_ack) {
    to_acknowledge_ = session.own_number();
    acknowledge_by_ = path;
  }
  if (piece.number > counter) {
    ++refused_.malformed;
    return;
  }
  const MessageNumber message{session.generation(), counter - piece.number};
  if (piece.number == 0 && piece.count > 1 && rules_.latest_only.has(piece.channel)) {
    reassembly_.drop_older(piece.channel, message);
  }
  if (const auto whole = reassembly_.take(m.now, message, piece)) deliver(*whole, m.now);
}

void PeerLink::deliver(const Reassembly::Whole& whole, Instant now) {
  if (!rules_.receive.has(whole.channel) || whole.channel.starts_with(kOwnChannels)) {
    ++counters_.not_allowed;
    return;
  }
  if (rules_.timed.has(whole.channel)) {
    const std::optional<IntervalNs> apart = offset_.at(now);
    if (apart && std::abs(nearest_to_zero_s(*apart)) >= to_seconds(settings_.clock_limit)) {
      ++counters_.clock_refused;
      return;
    }
  }
  if (rules_.latest_only.has(whole.channel)) {
    const auto known = newest_of_.find(whole.channel);
    if (known != newest_of_.end() && whole.number < known->second) {
      ++counters_.superseded;
      return;
    }
    if (known == newest_of_.end() && newest_of_.size() >= kMostLatestChannels) newest_of_.clear();
    newest_of_.insert_or_assign(std::string(whole.channel), whole.number);
  }
  ++counters_.delivered;
  out_.deliver(whole.channel, whole.bytes);
}

void PeerLink::on_ack(const Session& session, const Ack& ack) {
  counters_.copies_saved += static_cast<std::int64_t>(std::erase_if(copies_, [&](const Copy& copy) {
    if (copy.session != session.own_number() || copy.counter > ack.newest) return false;
    const std::uint64_t age = ack.newest - copy.counter;
    return age < 64 && (ack.bits >> age & 1) != 0;
  }));
}

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
