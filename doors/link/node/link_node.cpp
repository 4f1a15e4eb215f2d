#include "doors/link/node/link_node.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <optional>
#include <stdexcept>
#include <tether/path_fates_t.hpp>
#include <utility>

#include "common/lcm/udp_sockets.hpp"
#include "common/node/message_io.hpp"
#include "doors/link/sessions.hpp"

namespace tether::link {
namespace {

/// Clocks that drift or are measured again are no news.
constexpr double kClockNews_s = 5.0;
/// Share of a bound that clocks must come back to.
constexpr double kBack = 0.8;
constexpr char kCrossed[] =
    "its paths are in another order than ours: put [[path]] and addresses in the same one";

}  // namespace

std::string Diagnosis::clocks_apart(double ahead_s) {
  if (std::abs(ahead_s - ahead_said_s_) > kClockNews_s) ahead_said_s_ = ahead_s;
  return fmt::format(
      "the clocks are {:+.1f} s apart, at most {:.0f} s are allowed: set both (chrony, NTP)",
      ahead_said_s_, to_seconds(Sessions::kMostClockDifference));
}

/// Empty if they do not. Neither noise about a bound nor a small change is news.
std::string Diagnosis::clocks_differ(const Sight& sight) {
  const double now_s = std::abs(sight.clock_offset_s);
  const double bound_s = std::min(sight.clock_warning_s, sight.clock_limit_s);
  const bool differ = now_s >= bound_s * (differ_said_s_ > 0.0 ? kBack : 1.0);
  if (!differ) {
    differ_said_s_ = 0.0;
    return "";
  }
  const bool said_too_far = differ_said_s_ >= sight.clock_limit_s;
  const bool too_far = now_s >= sight.clock_limit_s * (said_too_far ? kBack : 1.0);
  const double ratio = now_s / std::max(differ_said_s_, 1e-9);
  if (ratio > 2.0 || ratio < 0.5 || too_far != said_too_far) differ_said_s_ = now_s;
  return fmt::format("; the clocks are {:.0f} ms apart at least{}: set both (chrony, NTP)",
                     differ_said_s_ * 1e3,
                     too_far ? ", and messages for a time, such as plans, are refused" : "");
}

std::string Diagnosis::how_up(const Sight& sight) {
  std::string line = fmt::format("up, by {}", fmt::join(sight.alive, " and "));
  if (!sight.dead.empty()) line += fmt::format("; {} is down", fmt::join(sight.dead, ", "));
  if (sight.crossed) line += fmt::format("; {}", kCrossed);
  if (!sight.narrow.empty()) {
    line += fmt::format("; {} does not carry packets of {} bytes: set a smaller mtu, on both hosts",
                        fmt::join(sight.narrow, ", "), sight.mtu);
  }
  if (std::abs(sight.clock_offset_s) > to_seconds(Sessions::kMostClockDifference)) {
    line += fmt::format("; no new session can begin: {}", clocks_apart(sight.clock_offset_s));
  } else {
    line += clocks_differ(sight);
  }
  return line;
}

std::string Diagnosis::why_down(const Sight& sight) {
  const Refusals& now = sight.refused;
  // Authenticated traffic.
  if (now.clock > then_.clock) {
    return fmt::format("{}; or an old handshake is replayed", clocks_apart(sight.clock_ahead_s));
  }
  if (sight.crossed) return kCrossed;
  // Anybody may send these, so that they are a hint: what came most often.
  struct Hint {
    std::int64_t count;
    const char* text;
  };
  const std::array<Hint, 4> hints{
      {{now.forged - then_.forged,
        "keys differ: compare each host's `tether-link show` with public_key on the other"},
       {now.version - then_.version,
        "another version runs there: install the same Tether on both hosts"},
       {now.address - then_.address,
        "it sends from elsewhere than its `addresses` here say: correct them"},
       {now.unknown_key - then_.unknown_key,
        "its key is another now: compare its `tether-link show` with public_key here"}}};
  const auto most = std::max_element(
      hints.begin(), hints.end(), [](const Hint& a, const Hint& b) { return a.count < b.count; });
  if (most->count > 0) return fmt::format("nothing authentic arrives; perhaps {}", most->text);
  return "nothing arrives: is tether-link running there, are addresses, ports and firewalls right?";
}

std::optional<Diagnosis::Line> Diagnosis::look(Instant now, const Sight& sight) {
  const bool up = !sight.alive.empty();
  if (up) {
    since_.reset();
  } else if (!since_) {
    since_ = now;
    then_ = sight.refused;
  }
  was_up_ = was_up_ || up;
  if (!up && !was_up_ && now - *since_ < kPatience) return std::nullopt;
  const std::string line = up ? how_up(sight) : fmt::format("down: {}", why_down(sight));
  if (line == said_) return std::nullopt;
  said_ = line;
  const bool well = up && line.find(';') == std::string::npos;
  return Line{well ? Severity::info : Severity::warning,
              fmt::format("peer \"{}\": {}", peer_, line)};
}

namespace {

constexpr int kBufferBytes = 2 << 20;

sockaddr_in to_system(const Address& address) {
  sockaddr_in out{};
  out.sin_family = AF_INET;
  out.sin_port = htons(address.port);
  out.sin_addr.s_addr = htonl(address.ip);
  return out;
}

}  // namespace

std::int64_t wall_ns() {
  timespec t{};
  clock_gettime(CLOCK_REALTIME, &t);
  return t.tv_sec * 1'000'000'000LL + t.tv_nsec;
}

PathSocket::PathSocket(const PathConfig& config) : config_(config) {
  if (open() || errno == ENODEV || errno == EADDRNOTAVAIL) return;
  throw std::runtime_error(fmt::format("path \"{}\": {}", config_.name, trouble_));
}

PathSocket::~PathSocket() { shut(); }

void PathSocket::shut() {
  if (fd_ < 0) return;
  dropped_before_ += dropped_datagrams({fd_});
  close(std::exchange(fd_, -1));
}

bool PathSocket::fail(const std::string& what) {
  const int error = errno;
  trouble_ = fmt::format("{}: {}", what, std::strerror(error));
  shut();
  errno = error;
  return false;
}

bool PathSocket::open() {
  const std::string& interface = config_.interface;
  // Before it is bound: if another takes its place meanwhile, that is noticed.
  interface_index_ = if_nametoindex(interface.c_str());
  fd_ = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd_ < 0) return fail("no socket");
  const auto set = [this](int level, int name, int value) {
    return setsockopt(fd_, level, name, &value, sizeof value) == 0;
  };
  set(SOL_SOCKET, SO_RCVBUF, kBufferBytes);
  set(SOL_SOCKET, SO_SNDBUF, kBufferBytes);
  if (!set(SOL_SOCKET, SO_TIMESTAMPNS, 1)) return fail("no times of arrival");
  // Not DO, which believes any sender of ICMP packets: long PROBEs measure the size (PeerLink).
  if (!set(IPPROTO_IP, IP_MTU_DISCOVER, IP_PMTUDISC_PROBE)) return fail("no path MTU");
  if (!interface.empty() && setsockopt(fd_, SOL_SOCKET, SO_BINDTODEVICE, interface.c_str(),
                                       static_cast<socklen_t>(interface.size())) != 0) {
    return fail(fmt::format("cannot use interface \"{}\" (`ip link` lists them)", interface));
  }
  const sockaddr_in own = to_system(config_.bind);
  if (bind(fd_, reinterpret_cast<const sockaddr*>(&own), sizeof own) != 0) {
    return fail(
        fmt::format("cannot bind to {} (is another tether-link running; is it an address of this "
                    "host?)",
                    to_text(config_.bind)));
  }
  trouble_.clear();
  return true;
}

bool PathSocket::is_current() const {
  return fd_ >= 0 && (config_.interface.empty() ||
                      if_nametoindex(config_.interface.c_str()) == interface_index_);
}

void PathSocket::reopen() {
  shut();
  open();
}

bool PathSocket::send(const Address& to, ByteView datagram) {
  const sockaddr_in address = to_system(to);
  if (sendto(fd_, datagram.data(), datagram.size(), MSG_DONTWAIT,
             reinterpret_cast<const sockaddr*>(&address), sizeof address) >= 0) {
    return true;
  }
  ++unsent_;
  too_long_ = too_long_ || errno == EMSGSIZE;
  return false;
}

void PathSocket::receive(const std::function<void(const Address&, ByteView, std::int64_t)>& take) {
  // Errors here are those of single datagrams, or of an interface that is gone for a while.
  const int count = batch_.receive(fd_);
  for (std::size_t i = 0; static_cast<int>(i) < count; ++i) {
    const sockaddr_in& from = batch_.sender(i);
    const std::optional<std::int64_t> arrival_ns = batch_.arrival_ns(i);
    take({ntohl(from.sin_addr.s_addr), ntohs(from.sin_port)}, batch_.datagram(i),
         arrival_ns ? *arrival_ns : wall_ns());
  }
}

std::int64_t PathSocket::dropped() const {
  return dropped_before_ + (fd_ < 0 ? 0 : dropped_datagrams({fd_}));
}

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
