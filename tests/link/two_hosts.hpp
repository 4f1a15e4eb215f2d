#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/base/random.hpp"
#include "doors/link/peer_link.hpp"

namespace tether::link::testing {

/// Key number `n` of a test.
inline Key key_number(std::uint64_t n) {
  RandomEngine random(n);
  Key key{};
  for (std::uint8_t& byte : key) byte = static_cast<std::uint8_t>(random());
  return key;
}
inline RandomKey random_keys(std::uint64_t seed) {
  return [seed, n = std::uint64_t{0}]() mutable { return key_number(split_mix(seed + ++n)); };
}

inline constexpr std::int64_t kDay_ns = 86'400'000'000'000;
inline Address host_address(std::size_t host, std::size_t path) {
  return {static_cast<std::uint32_t>(0x0A000000 + 256 * path + host), 7700};
}

/// Two hosts and what is between them, in virtual time. Host 0 sends CMD, BIG and LATEST, host 1
/// sends POSE.
class TwoHosts {
 public:
  struct Datagram {
    std::size_t from = 0;
    std::size_t path = 0;
    Bytes bytes;
  };
  struct Heard {
    std::string channel;
    Bytes bytes;
    Instant when;
  };
  struct Host {
    KeyPair keys;
    std::int64_t clock_ahead_ns = 0;
    std::unique_ptr<Endpoint> endpoint;
    std::vector<Heard> heard;
  };

  explicit TwoHosts(const LinkSettings& settings = {}, std::uint64_t seed = 1)
      : settings_(settings), seed_(seed) {
    for (std::size_t i = 0; i < 2; ++i) hosts[i].keys = key_pair_of(key_number(seed + 100 * i));
    for (std::size_t i = 0; i < 2; ++i) restart(i);
  }

  /// Forgets everything but keys.
  void restart(std::size_t i) {
    PeerSetup peer;
    peer.key = peer_key[i].value_or(hosts[1 - i].keys.public_key);
    peer.rules.send =
        SendRules(i == 0 ? std::vector<std::string>{"CMD|BIG|LATEST", "LINK/REPORT -> CMD"}
                         : std::vector<std::string>{"POSE|SECRET", "FAKE -> LINK/REPORT"});
    peer.rules.receive = ChannelList({i == 0 ? "POSE|LINK/.*" : "CMD|BIG|LATEST"});
    peer.rules.latest_only = ChannelList({"LATEST"});
    peer.rules.timed = ChannelList({"BIG"});
    for (std::size_t path = 0; path < settings_.paths; ++path) {
      peer.addresses.push_back(knows_address[i] ? std::optional{host_address(1 - i, path)}
                                                : std::nullopt);
    }
    hosts[i].endpoint = std::make_unique<Endpoint>(
        hosts[i].keys, std::vector{peer}, settings_,
        Endpoint::Output{
            [this, i](std::size_t path, const Address& to, ByteView datagram) {
              carry(i, path, to, datagram);
            },
            [this, i](std::size_t, std::string_view channel, ByteView bytes) {
              hosts[i].heard.push_back({std::string(channel), {bytes.begin(), bytes.end()}, now});
            }},
        random_keys(seed_ + 1000 * ++starts_));
  }

  Moment moment(std::size_t host) const {
    return {now, kDay_ns + now.time_since_epoch().count() + hosts[host].clock_ahead_ns};
  }
  PeerLink& link(std::size_t host) { return hosts[host].endpoint->peer(0); }
  const Refusals& refused(std::size_t host) const { return hosts[host].endpoint->refused(); }

  void send(std::size_t host, const std::string& channel, const Bytes& bytes) {
    hosts[host].endpoint->send(channel, bytes, moment(host));
  }
  /// A datagram of anybody arrives at a host.
  void inject(std::size_t host, std::size_t path, ByteView bytes,
              std::optional<Address> from = {}) {
    hosts[host].endpoint->take(path, from.value_or(place_of(1 - host, path)), bytes, moment(host));
    hosts[host].endpoint->flush(moment(host));
  }

  void run(Duration time) {
    const Instant end = now + time;
    while (now < end) {
      const Instant next = under_way_.empty() ? end : under_way_.begin()->first;
      const Instant stop = std::min({end, next, next_tick_});
      now = std::max(now, stop);
      if (next_tick_ <= now) {
        for (Host& host : hosts) {
          host.endpoint->tick(moment(static_cast<std::size_t>(&host - hosts.data())));
        }
        next_tick_ = now + tick;
      }
      while (!under_way_.empty() && under_way_.begin()->first <= now) {
        const Datagram datagram = std::move(under_way_.begin()->second);
        under_way_.erase(under_way_.begin());
        inject(1 - datagram.from, datagram.path, datagram.bytes);
      }
    }
  }
  /// Until both can send.
  void connect() { run(std::chrono::milliseconds{200}); }

  std::array<Host, 2> hosts;
  Instant now = kStart;
  Duration tick = std::chrono::milliseconds{1};
  /// Whether the network loses it.
  std::function<bool(const Datagram&)> loses = [](const Datagram&) { return false; };
  std::function<Duration(const Datagram&)> delay = [](const Datagram&) {
    return std::chrono::milliseconds{2};
  };
  std::vector<Datagram> seen;  ///< all that was sent, if kept
  bool keep = false;
  std::array<bool, 2> knows_address{true, true};
  std::array<std::uint16_t, 2> port{7700, 7700};  ///< from which a host sends, and where it hears
  std::array<std::optional<Key>, 2> peer_key;     ///< another one than the other host's; restart()

 private:
  Address place_of(std::size_t host, std::size_t path) const {
    return {host_address(host, path).ip, port[host]};
  }
  void carry(std::size_t from, std::size_t path, const Address& to, ByteView bytes) {
    if (to != place_of(1 - from, path)) return;
    Datagram datagram{from, path, {bytes.begin(), bytes.end()}};
    if (keep) seen.push_back(datagram);
    if (!loses(datagram)) under_way_.emplace(now + delay(datagram), std::move(datagram));
  }

  LinkSettings settings_;
  std::uint64_t seed_;
  std::uint64_t starts_ = 0;
  Instant next_tick_ = kStart;
  std::multimap<Instant, Datagram> under_way_;
};

inline LinkSettings two_paths() {
  LinkSettings settings;
  settings.paths = 2;
  return settings;
}

inline Bytes numbered(std::uint32_t number) {
  Bytes bytes;
  Writer(bytes).number(number);
  return bytes;
}

/// Sends `count` numbered messages of host 0, one each millisecond.
inline void send_numbers(TwoHosts& net, std::uint32_t count, const std::string& channel = "CMD") {
  for (std::uint32_t i = 0; i < count; ++i) {
    net.send(0, channel, numbered(i));
    net.run(std::chrono::milliseconds{1});
  }
  net.run(std::chrono::milliseconds{300});
}

/// The numbers that host 1 heard; each must have come once.
inline std::set<std::uint32_t> numbers_heard(const TwoHosts& net) {
  std::set<std::uint32_t> numbers;
  for (const auto& heard : net.hosts[1].heard) {
    const bool is_new = numbers.insert(Reader(heard.bytes).number<std::uint32_t>()).second;
    EXPECT_TRUE(is_new) << "twice";
  }
  return numbers;
}

}  // namespace tether::link::testing
