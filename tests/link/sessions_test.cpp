#include "doors/link/sessions.hpp"

#include <gtest/gtest.h>

#include "tests/link/two_hosts.hpp"

namespace tether::link {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::key_number;
using testing::TwoHosts;

/// Sessions of two hosts with each other, without a network.
struct Ends {
  KeyPair a = key_pair_of(key_number(1)), b = key_pair_of(key_number(2));
  Identity at_a{a, b.public_key}, at_b{b, a.public_key};
  Refusals refused_at_a, refused_at_b;
  RekeySettings rekey{seconds{60}};
  Sessions of_a{at_a, 0, rekey, testing::random_keys(3), refused_at_a};
  Sessions of_b{at_b, 0, rekey, testing::random_keys(4), refused_at_b};
  Moment m{kStart, testing::kDay_ns};

  void wait(Duration time) {
    m.now += time;
    m.wall_ns += time.count();
  }
  Bytes hello(std::uint64_t number) const {
    return Handshake::hello(at_a, key_pair_of(key_number(100 + number)), 0x100, m.wall_ns);
  }
  /// a opens a session. Its number at a.
  std::uint32_t open() {
    const auto hello = of_a.due_hello(m, true);
    EXPECT_TRUE(hello);
    const auto answer = of_b.on_hello(*hello, m);
    EXPECT_TRUE(answer);
    const std::uint32_t at_b = read_answer(*answer)->session;
    EXPECT_TRUE(of_a.on_answer(*answer, m));
    EXPECT_TRUE(of_b.confirm(*of_b.find(at_b), m.now));
    return of_a.current()->own_number();
  }
};

TEST(Sessions, TakeEachHelloOnce) {
  Ends e;
  const Bytes first = e.hello(1);
  EXPECT_TRUE(e.of_b.on_hello(first, e.m));
  EXPECT_TRUE(e.of_b.on_hello(first, e.m)) << "by the other path: the same answer again";
  EXPECT_FALSE(e.of_b.on_hello(first, e.m)) << "no host has three paths";
  e.wait(seconds{1});
  EXPECT_TRUE(e.of_b.on_hello(e.hello(2), e.m));
  EXPECT_FALSE(e.of_b.on_hello(first, e.m));
  EXPECT_EQ(e.refused_at_b.replayed, 2);
}

TEST(Sessions, TakeNoHelloOlderThanTheNewest) {
  Ends e;
  const Bytes first = e.hello(1);
  e.wait(seconds{1});
  const Bytes second = e.hello(2);
  EXPECT_TRUE(e.of_b.on_hello(second, e.m));
  EXPECT_FALSE(e.of_b.on_hello(first, e.m)) << "it would displace the second";
  EXPECT_EQ(e.refused_at_b.replayed, 1);
  e.m.wall_ns -= 30'000'000'000;  // both clocks are set back
  EXPECT_FALSE(e.of_b.on_hello(e.hello(3), e.m));
  e.wait(seconds{31});
  EXPECT_TRUE(e.of_b.on_hello(e.hello(4), e.m));
}

TEST(Sessions, AnAnsweredOneWithoutConfirmationEnds) {
  Ends e;
  const auto answer = e.of_b.on_hello(e.hello(1), e.m);
  const std::uint32_t number = read_answer(*answer)->session;
  EXPECT_NE(e.of_b.find(number), nullptr);
  e.wait(Sessions::kAnsweredLife + seconds{1});
  e.of_b.due_hello(e.m, false);
  EXPECT_EQ(e.of_b.find(number), nullptr);
}

TEST(Sessions, TheOneBeforeEndsSoonAndTheLastOneSomeDay) {
  Ends e;
  const std::uint32_t first = e.open();
  e.wait(seconds{1});
  const std::uint32_t second = e.open();
  EXPECT_NE(e.of_a.find(first), nullptr) << "what was under way still counts";
  e.wait(Sessions::kPreviousLife + seconds{1});
  e.of_a.due_hello(e.m, false);
  EXPECT_EQ(e.of_a.find(first), nullptr);
  EXPECT_NE(e.of_a.find(second), nullptr);
  e.wait(2 * e.rekey.after);
  e.of_a.due_hello(e.m, false);
  EXPECT_EQ(e.of_a.find(second), nullptr) << "without new keys there are none";
}

TEST(Session, SealsTheSameTextOtherwiseEachTime) {
  Session session({key_number(1), key_number(2), 0x100, 0x200}, true, kStart);
  Bytes first, second;
  session.seal(Bytes(40, 7), first);
  session.seal(Bytes(40, 7), second);
  const auto text = [](const Bytes& d) {
    return Bytes(d.begin() + kSealedHeaderBytes, d.end() - kTagBytes);
  };
  EXPECT_NE(text(first), text(second)) << "a nonce that comes twice gives the key's stream away";
}

TEST(PeerLink, ReplayedDatagramsDoNotMakeAPathLookAlive) {
  TwoHosts net;
  net.keep = true;
  net.connect();
  net.send(0, "CMD", {1});
  net.run(seconds{1});
  const std::vector<TwoHosts::Datagram> recorded = net.seen;
  net.keep = false;
  net.loses = [](const TwoHosts::Datagram&) { return true; };
  net.run(seconds{2});
  for (const TwoHosts::Datagram& d : recorded) net.inject(1 - d.from, d.path, d.bytes);
  EXPECT_GT(net.refused(1).replayed, 3);
  EXPECT_FALSE(net.link(1).alive(0, net.now));
  EXPECT_FALSE(net.link(1).up(net.now));
}

TEST(PeerLink, WhatTheLinkReportsStaysOnItsHost) {
  TwoHosts net;
  net.connect();
  net.send(0, "LINK/REPORT", {1});  // host 0 has a rule for it
  net.run(milliseconds{10});
  EXPECT_TRUE(net.hosts[1].heard.empty());
  EXPECT_EQ(net.link(0).counters().sent, 0);
}

}  // namespace
}  // namespace tether::link
