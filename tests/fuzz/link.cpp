#include <string>
#include <utility>

#include "tests/fuzz/fuzz.hpp"
#include "tests/fuzz/script.hpp"
#include "tests/link/two_hosts.hpp"

namespace tether::fuzzing {
namespace {

using link::Bytes;
using link::ByteView;
using link::testing::TwoHosts;
using std::chrono::milliseconds;

constexpr milliseconds kMost_ms{250};

/// Datagrams of a sender without a key, at any time of two hosts' life: whole, and made from the
/// hosts' own.
void play_unknown_sender(Script& script, TwoHosts& net) {
  switch (script.choice(6)) {
    case 0:
      net.run(std::min(milliseconds{script.byte()}, kMost_ms));
      break;
    case 1:
      net.restart(script.choice(2));
      break;
    case 2:
      net.send(0, script.choice(2) == 0 ? "CMD" : "LATEST", Bytes(script.byte() * 20U, 1));
      break;
    case 3:
      net.inject(script.choice(2), script.choice(2), script.take_some());
      break;
    default: {
      if (net.seen.empty()) return;
      TwoHosts::Datagram d = net.seen[script.number<std::uint16_t>() % net.seen.size()];
      const std::size_t from = script.choice(4) == 0 ? 1 - d.from : d.from;
      const auto change = script.take(script.choice(4));
      for (std::size_t i = 0; i + 1 < change.size() && !d.bytes.empty(); i += 2) {
        d.bytes[change[i] % d.bytes.size()] ^= change[i + 1];
      }
      net.inject(1 - from, script.choice(2), d.bytes);
    }
  }
}

/// Nothing is delivered that was not sent, and nothing twice; and the two still hear each other.
void try_unknown_sender(Script& script) {
  TwoHosts net(link::testing::two_paths());
  net.tick = milliseconds{10};
  net.keep = true;
  for (int i = 0; i < 100 && !script.ended(); ++i) {
    play_unknown_sender(script, net);
    for (const auto& heard : net.hosts[1].heard) {
      must(heard.channel == "CMD" || heard.channel == "LATEST", "no other messages");
    }
    if (net.seen.size() > 5000) net.seen.clear();
  }
  must(net.hosts[0].heard.empty(), "host 1 has said nothing");
  net.run(std::chrono::seconds{5});
  const std::size_t before = net.hosts[1].heard.size();
  const std::int64_t sent = net.link(0).counters().sent;
  net.send(0, "CMD", {7});
  net.run(milliseconds{20});
  must(net.link(0).counters().sent == sent + 1, "there is a session whatever came");
  must(net.hosts[1].heard.size() == before + 1, "and messages arrive");
}

/// A peer with the right key that says anything: malformed texts, impossible pieces, wild times.
void try_peer(Script& script) {
  TwoHosts net(link::testing::two_paths());
  const link::KeyPair own = net.hosts[0].keys;
  const link::Identity identity(own, net.hosts[1].keys.public_key);
  const link::KeyPair ephemeral = link::key_pair_of(link::testing::key_number(9));
  const link::Bytes hello =
      link::Handshake::hello(identity, ephemeral, 0x100, net.moment(0).wall_ns);
  net.keep = true;
  net.inject(1, 0, hello);
  must(net.seen.size() == 1, "an authentic HELLO is answered");
  const auto keys = link::Handshake::finish(identity, hello, ephemeral, net.seen[0].bytes);
  must(keys.has_value(), "by an authentic ANSWER");
  net.keep = false;
  link::Session session(*keys, true, net.now);
  Bytes text, datagram;
  while (!script.ended()) {
    if (script.choice(3) == 0) {
      const ByteView raw = script.take_some();
      text.assign(raw.begin(), raw.end());
    } else {
      link::Piece piece;
      piece.wants_ack = script.choice(2) == 0;
      piece.number = script.byte() % 8;
      piece.count = script.number<std::uint16_t>() % (script.choice(2) == 0 ? 9 : 3000);
      piece.channel = script.choice(2) == 0 ? "BIG" : "LATEST";
      piece.bytes = script.take_some();
      link::write_text(text, {script.number<std::int64_t>(), piece});
    }
    session.seal(text, datagram);
    net.inject(1, script.choice(2), datagram);
    if (script.choice(8) == 0) net.now += milliseconds{script.byte() * 10};
  }
  (void)net.link(1).report(0, net.now);
  (void)net.link(1).offset(net.now);
}

}  // namespace

void try_input(std::span<const std::uint8_t> input) {
  Script script(input);
  if (script.choice(2) == 0) {
    try_unknown_sender(script);
  } else {
    try_peer(script);
  }
}

}  // namespace tether::fuzzing
