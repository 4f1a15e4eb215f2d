#include "link/node/link_node.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <tether/path_fates_t.hpp>
#include <utility>

#include "common/bus/message_io.hpp"

namespace tether::link {
namespace {

constexpr Duration kTick = std::chrono::milliseconds{10};
constexpr Duration kRenew = std::chrono::seconds{1};
constexpr Duration kLook = std::chrono::milliseconds{100};
/// Time without any datagram after which a peer is reported down, within a second.
constexpr double kSilence_s = 0.85;
constexpr Duration kTooLongMemory = std::chrono::seconds{5};
constexpr Duration kFates = std::chrono::seconds{1};
constexpr std::size_t kFatesPerMessage = 2500;  // one datagram of LCM
constexpr double kNsPerMs = 1e6;

}  // namespace

LinkNode::LinkNode(LinkConfig config, const KeyPair& own, EventLoop& loop, Bus& bus,
                   const RandomKey& random, Say say)
    : config_(std::move(config)),
      loop_(loop),
      bus_(bus),
      say_(std::move(say)),
      endpoint_(own, config_.setups(), config_.settings,
                {[this](std::size_t path, const Address& to, ByteView datagram) {
                   sockets_[path].send(to, datagram);
                 },
                 [this](std::size_t, std::string_view channel, ByteView bytes) {
                   bus_.publish(channel, bytes);
                 }},
                random),
      too_long_(config_.paths.size()) {
  assert(!bus_.hears_itself());
  for (const PathConfig& path : config_.paths) sockets_.emplace_back(path);
  for (const PeerConfig& peer : config_.peers) diagnoses_.emplace_back(peer.name);
  for (std::size_t path = 0; path < sockets_.size(); ++path) open_path(path);
  bus_.subscribe(".*", kDeepQueue, [this](const Message& m) { on_message(m); });
  const Instant now = loop_.now();
  loop_.every(now, kTick, Priority::node, [this](Instant) { endpoint_.tick(moment()); });
  loop_.every(now + kRenew, kRenew, Priority::observer, [this](Instant) { renew_paths(); });
  loop_.every(now + kLook, kLook, Priority::observer, [this](Instant) { diagnose(); });
  loop_.every(now + config_.report_period, config_.report_period, Priority::observer,
              [this](Instant) { report(); });
  loop_.every(now + kFates, kFates, Priority::observer, [this](Instant) { tell_fates(); });
}

LinkNode::~LinkNode() {
  for (const PathSocket& socket : sockets_) {
    if (socket.fd() >= 0) loop_.remove_fd(socket.fd());
  }
}

void LinkNode::open_path(std::size_t path) {
  const PathSocket& socket = sockets_[path];
  const std::string name = fmt::format("path \"{}\"", config_.paths[path].name);
  if (socket.fd() < 0) {
    say_(Severity::warning,
         fmt::format("{} is closed, and tried again each second: {}", name, socket.trouble()));
    return;
  }
  loop_.add_fd(socket.fd(), [this, path](Instant) { on_readable(path); });
  say_(Severity::info, fmt::format("{} on {}", name, to_text(config_.paths[path].bind)));
}

void LinkNode::renew_paths() {
  for (std::size_t path = 0; path < sockets_.size(); ++path) {
    PathSocket& socket = sockets_[path];
    if (socket.is_current()) continue;
    const std::string trouble = socket.trouble();
    if (socket.fd() >= 0) loop_.remove_fd(socket.fd());
    socket.reopen();
    if (socket.fd() >= 0 || socket.trouble() != trouble) open_path(path);
  }
}

void LinkNode::on_message(const Message& message) {
  endpoint_.send(message.channel, message.bytes, moment());
  if (!config_.settings.second_after || copies_scheduled_) return;
  copies_scheduled_ = true;
  loop_.at(loop_.now() + *config_.settings.second_after, Priority::node, [this](Instant) {
    copies_scheduled_ = false;
    endpoint_.send_copies(loop_.now());
  });
}

void LinkNode::on_readable(std::size_t path) {
  sockets_[path].receive([&](const Address& from, ByteView datagram, std::int64_t arrival_ns) {
    endpoint_.take(path, from, datagram, {loop_.now(), arrival_ns});
  });
  endpoint_.flush(moment());
}

void LinkNode::report() {
  for (std::size_t i = 0; i < endpoint_.size(); ++i) report_peer(i);
  ++seq_;
}

void LinkNode::report_peer(std::size_t number) {
  PeerLink& peer = endpoint_.peer(number);
  const Instant now = loop_.now();
  peer_report_t r{};
  r.utime = wall_ns() / 1000;
  r.seq = seq_;
  r.peer = config_.peers[number].name;
  r.up = peer.up(now) ? 1 : 0;
  r.age_s = peer.age_s(now);
  r.sessions = peer.sessions().count();
  const std::optional<IntervalNs> offset = peer.offset(now);
  r.offset_known = offset ? 1 : 0;
  if (offset) {
    r.offset_min_ms = static_cast<double>(offset->min_ns) / kNsPerMs;
    r.offset_max_ms = static_cast<double>(offset->max_ns) / kNsPerMs;
    const double apart_s = std::abs(nearest_to_zero_s(*offset));
    r.clocks_apart = apart_s >= to_seconds(config_.clock_warning) ? 1 : 0;
  }
  r.clock_steps = peer.clock_steps();
  const PeerCounters& c = peer.counters();
  r.sent = c.sent;
  r.unsent = c.unsent;
  r.delivered = c.delivered;
  r.not_allowed = c.not_allowed;
  r.clock_refused = c.clock_refused;
  r.superseded = c.superseded;
  r.incomplete = peer.incomplete();
  r.duplicates = c.duplicates;
  r.copies = c.copies;
  r.copies_saved = c.copies_saved;
  for (std::size_t path = 0; path < sockets_.size(); ++path) report_path(peer, path, offset, r);
  r.paths = static_cast<std::int32_t>(sockets_.size());
  CounterList refused;
  endpoint_.refused().list(refused);
  for (auto& [name, value] : refused) {
    r.refused.push_back(std::move(name));
    r.refused_count.push_back(value);
  }
  r.count = static_cast<std::int32_t>(r.refused.size());
  publish(bus_, kReportChannel, r);
}

void LinkNode::report_path(PeerLink& peer, std::size_t path,
                           const std::optional<IntervalNs>& offset, peer_report_t& out) {
  const PathReport p = peer.report(path, loop_.now());
  out.path.push_back(config_.paths[path].name);
  out.path_alive.push_back(p.alive ? 1 : 0);
  out.path_age_s.push_back(p.age_s);
  out.path_gap_s.push_back(p.longest_gap_s);
  out.path_sent.push_back(p.sent);
  out.path_unsent.push_back(sockets_[path].unsent());
  out.path_dropped.push_back(sockets_[path].dropped());
  out.path_received.push_back(p.received);
  out.path_first.push_back(p.first);
  out.path_lost.push_back(p.lost);
  out.path_loss.push_back(p.recent_loss);
  const LossBursts& bursts = peer.bursts(path);
  const auto count = static_cast<double>(bursts.count);
  out.path_bursts.push_back(bursts.count);
  out.path_burst_mean.push_back(count > 0.0 ? static_cast<double>(bursts.lost) / count : 0.0);
  out.path_burst_longest.push_back(bursts.longest);
  const bool known = offset && p.transit_max_ns;
  // No delay is negative, whatever the bound says.
  const auto delay_ms = [known](double transit_ns, std::int64_t offset_ns) {
    return known ? std::max(0.0, (transit_ns + static_cast<double>(offset_ns)) / kNsPerMs) : -1.0;
  };
  const IntervalNs bounds = offset.value_or(IntervalNs{});
  const auto worst_ns = static_cast<double>(p.transit_max_ns.value_or(0));
  out.path_delay_min_ms.push_back(delay_ms(p.transit_mean_ns, bounds.min_ns));
  out.path_delay_max_ms.push_back(delay_ms(p.transit_mean_ns, bounds.max_ns));
  out.path_worst_min_ms.push_back(delay_ms(worst_ns, bounds.min_ns));
  out.path_worst_max_ms.push_back(delay_ms(worst_ns, bounds.max_ns));
  out.path_round_trip_ms.push_back(
      p.round_trip_min_ns ? static_cast<double>(*p.round_trip_min_ns) / kNsPerMs : -1.0);
}

void LinkNode::tell_fates() {
  for (std::size_t peer = 0; peer < endpoint_.size(); ++peer) {
    for (std::size_t path = 0; path < sockets_.size(); ++path) tell_fates_of(peer, path);
  }
}

void LinkNode::tell_fates_of(std::size_t peer, std::size_t path) {
  const std::vector<Fate> fates = endpoint_.peer(peer).take_fates(path);
  const std::optional<IntervalNs> offset = endpoint_.peer(peer).offset(loop_.now());
  for (std::size_t begin = 0; begin < fates.size(); begin += kFatesPerMessage) {
    path_fates_t m{};
    m.utime = wall_ns() / 1000;
    m.seq = fates_seq_++;
    m.peer = config_.peers[peer].name;
    m.path = config_.paths[path].name;
    m.offset_known = offset ? 1 : 0;
    const IntervalNs bounds = offset.value_or(IntervalNs{});
    m.offset_min_ms = static_cast<double>(bounds.min_ns) / kNsPerMs;
    m.offset_max_ms = static_cast<double>(bounds.max_ns) / kNsPerMs;
    for (std::size_t i = begin; i < std::min(begin + kFatesPerMessage, fates.size()); ++i) {
      m.sent_ns.push_back(fates[i].sent_ns);
      m.transit_ns.push_back(fates[i].transit_ns.value_or(0));
      m.lost.push_back(fates[i].transit_ns ? 0 : 1);
      m.anew.push_back(fates[i].after_gap ? 1 : 0);
    }
    m.count = static_cast<std::int32_t>(m.sent_ns.size());
    publish(bus_, kFatesChannel, m);
  }
}

void LinkNode::diagnose() {
  const Instant now = loop_.now();
  for (std::size_t path = 0; path < sockets_.size(); ++path) {
    if (sockets_[path].take_too_long()) too_long_[path] = now;
  }
  for (std::size_t i = 0; i < endpoint_.size(); ++i) {
    PeerLink& peer = endpoint_.peer(i);
    Diagnosis::Sight sight;
    const bool silent = peer.age_s(now) > kSilence_s;
    for (std::size_t path = 0; path < sockets_.size(); ++path) {
      const std::string& name = config_.paths[path].name;
      const bool alive = !silent && peer.alive(path, now);
      (alive ? sight.alive : sight.dead).push_back(name);
      const bool too_long = too_long_[path] && now - *too_long_[path] < kTooLongMemory;
      const bool narrow = too_long || !peer.carries_long(path);
      if (alive && narrow) sight.narrow.push_back(name);
      sight.crossed = sight.crossed || peer.is_crossed(path, now);
    }
    sight.mtu = config_.settings.datagram_bytes + kIpAndUdpBytes;
    if (const auto offset = peer.offset(now)) sight.clock_offset_s = nearest_to_zero_s(*offset);
    sight.clock_warning_s = to_seconds(config_.clock_warning);
    sight.clock_limit_s = to_seconds(config_.settings.clock_limit);
    sight.refused = endpoint_.refused();
    sight.clock_ahead_s = static_cast<double>(peer.sessions().clock_ahead_ns()) * 1e-9;
    if (const auto line = diagnoses_[i].look(now, sight)) say_(line->severity, line->text);
  }
}

}  // namespace tether::link
