#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <vector>

#include "common/base/errors.hpp"
#include "doors/link/sessions.hpp"
#include "tests/link/two_hosts.hpp"

namespace tether::link {
namespace {

using testing::key_number;

TEST(ReplayWindow, TakesEachCounterOnceInAnyOrder) {
  RandomEngine random(3);
  std::vector<std::uint64_t> counters(1000);
  for (std::size_t i = 0; i < counters.size(); ++i) counters[i] = i;
  std::shuffle(counters.begin(), counters.end(), random);
  ReplayWindow window;
  for (int round = 0; round < 2; ++round) {
    for (const std::uint64_t c : counters) {
      EXPECT_EQ(window.look(c) == ReplayWindow::Verdict::fresh, round == 0) << c;
      window.mark(c);
    }
  }
}

TEST(ReplayWindow, RemembersExactlyItsSizeAsASetDoes) {
  RandomEngine random(5);
  ReplayWindow window;
  std::set<std::uint64_t> marked;
  std::uint64_t newest = 0;
  for (int i = 0; i < 200'000; ++i) {
    const std::uint64_t jump = random() % 100 == 0 ? random() % 5000 : random() % 4;
    const std::uint64_t c =
        random() % 2 == 0 ? newest + jump : newest - std::min(newest, random() % 2200);
    using V = ReplayWindow::Verdict;
    const V expected = marked.empty() || c > newest        ? V::fresh
                       : newest - c >= ReplayWindow::kSize ? V::too_old
                       : marked.contains(c)                ? V::seen
                                                           : V::fresh;
    ASSERT_EQ(window.look(c), expected) << c << " after " << newest;
    window.mark(c);
    marked.insert(c);
    newest = std::max(newest, c);
  }
  EXPECT_EQ(window.newest(), newest);
}

TEST(ReplayWindow, JumpsToTheEndOfNumbers) {
  ReplayWindow window;
  window.mark(0);
  window.mark(UINT64_MAX);
  EXPECT_EQ(window.look(UINT64_MAX), ReplayWindow::Verdict::seen);
  EXPECT_EQ(window.look(UINT64_MAX - 1), ReplayWindow::Verdict::fresh);
  EXPECT_EQ(window.look(0), ReplayWindow::Verdict::too_old);
}

/// Two hosts that know each other, and a handshake between them.
struct Pair {
  KeyPair a = key_pair_of(key_number(1)), b = key_pair_of(key_number(2));
  KeyPair x = key_pair_of(key_number(3)), y = key_pair_of(key_number(4));
  Identity at_a{a, b.public_key}, at_b{b, a.public_key};
  Bytes hello = Handshake::hello(at_a, x, 0x100, 5);
};

TEST(Handshake, GivesBothSidesTheSameKeys) {
  const Pair p;
  EXPECT_TRUE(Handshake::is_authentic(p.at_b, p.hello));
  const auto answered = Handshake::answer(p.at_b, p.hello, p.y, 0x200, 6);
  ASSERT_TRUE(answered);
  const auto keys = Handshake::finish(p.at_a, p.hello, p.x, answered->answer);
  ASSERT_TRUE(keys);
  EXPECT_EQ(keys->send, answered->keys.receive);
  EXPECT_EQ(keys->receive, answered->keys.send);
  EXPECT_NE(keys->send, keys->receive);
  EXPECT_EQ(keys->own_session, answered->keys.peer_session);
  EXPECT_EQ(keys->peer_session, answered->keys.own_session);
}

TEST(Handshake, AnswersWithFewerBytesThanItWasAsked) {
  const Pair p;
  EXPECT_LT(Handshake::answer(p.at_b, p.hello, p.y, 0x200, 6)->answer.size(), p.hello.size());
}

TEST(Handshake, NoticesEveryBitThatIsChanged) {
  const Pair p;
  const Bytes answer = Handshake::answer(p.at_b, p.hello, p.y, 0x200, 6)->answer;
  for (std::size_t bit = 0; bit < 8 * p.hello.size(); ++bit) {
    Bytes changed = p.hello;
    changed[bit / 8] ^= static_cast<std::uint8_t>(1 << bit % 8);
    EXPECT_FALSE(Handshake::is_authentic(p.at_b, changed)) << "bit " << bit;
  }
  for (std::size_t bit = 0; bit < 8 * answer.size(); ++bit) {
    Bytes changed = answer;
    changed[bit / 8] ^= static_cast<std::uint8_t>(1 << bit % 8);
    EXPECT_FALSE(Handshake::finish(p.at_a, p.hello, p.x, changed)) << "bit " << bit;
  }
}

TEST(Handshake, AHelloIsNotItsSendersOwn) {
  const Pair p;
  EXPECT_FALSE(Handshake::is_authentic(p.at_a, p.hello));
}

TEST(Handshake, AStolenKeyOfTheResponderDoesNotPassForTheInitiator) {
  // With b's secret key, a HELLO of a's can be made (ss), but not the keys of the answer: se needs
  // a's secret key or b's ephemeral one.
  const Pair p;
  const KeyPair thief_x = key_pair_of(key_number(9));
  const Bytes forged = Handshake::hello(p.at_b, thief_x, 0x300, 5);
  EXPECT_FALSE(Handshake::is_authentic(p.at_b, forged)) << "directions have keys of their own";
  // Even with a HELLO that authenticates, a sender that has x and b, but not a, must guess se.
  const auto answered = Handshake::answer(p.at_b, p.hello, p.y, 0x200, 6);
  const KeyPair guess{p.a.public_key, key_number(10)};
  const Identity thief(guess, p.b.public_key);
  EXPECT_FALSE(Handshake::finish(thief, p.hello, p.x, answered->answer));
}

TEST(Handshake, StaticKeysAloneDoNotGiveASessionsKeys) {
  // Forward secrecy: all four public values and both static secret keys are known, x and y are not.
  const Pair p;
  const auto answered = Handshake::answer(p.at_b, p.hello, p.y, 0x200, 6);
  const KeyPair guess = key_pair_of(key_number(11));
  EXPECT_FALSE(Handshake::finish(p.at_a, p.hello, guess, answered->answer));
}

TEST(Handshake, RefusesPointsOfLowOrder) {
  const Pair p;
  EXPECT_THROW(Identity(p.a, Key{}), UsageError);
  Bytes hello = to_bytes(Hello{1, 2, 3, Key{}, {}});
  hello.resize(kHelloBytes);
  EXPECT_FALSE(Handshake::answer(p.at_b, hello, p.y, 4, 5));
}

TEST(Handshake, RefusesItsOwnKeyAsAPeers) {
  const Pair p;
  EXPECT_THROW(Identity(p.a, p.a.public_key), UsageError);
}

struct Sealed {
  SessionKeys ab{key_number(1), key_number(2), 0x100, 0x200};
  Session a{ab, true, kStart};
  Session b{{ab.receive, ab.send, 0x200, 0x100}, false, kStart};
  Bytes datagram, text;

  Opened open(Session& at, std::size_t path, const Bytes& bytes) {
    const auto header = read_sealed_header(bytes);
    return header ? at.open(path, *header, bytes, text) : Opened::forged;
  }
};

TEST(Session, OpensWhatTheOtherSideSealed) {
  Sealed s;
  const Bytes said{1, 2, 3};
  s.a.seal(said, s.datagram);
  EXPECT_EQ(s.datagram.size(), said.size() + 30);
  EXPECT_EQ(s.open(s.b, 0, s.datagram), Opened::fresh);
  EXPECT_EQ(s.text, said);
}

TEST(Session, TakesACounterOnceOnAllPathsTogether) {
  Sealed s;
  s.a.seal(Bytes{1}, s.datagram);
  EXPECT_EQ(s.open(s.b, 1, s.datagram), Opened::fresh);
  EXPECT_EQ(s.open(s.b, 0, s.datagram), Opened::duplicate);
  EXPECT_EQ(s.open(s.b, 0, s.datagram), Opened::replayed);
  EXPECT_EQ(s.open(s.b, 1, s.datagram), Opened::replayed);
}

TEST(Session, DoesNotOpenItsOwnDatagrams) {
  Sealed s;
  s.a.seal(Bytes{1}, s.datagram);
  EXPECT_EQ(s.open(s.a, 0, s.datagram), Opened::forged);
}

TEST(Session, NoticesEveryBitThatIsChanged) {
  Sealed s;
  s.a.seal(Bytes(40, 7), s.datagram);
  for (std::size_t bit = 0; bit < 8 * s.datagram.size(); ++bit) {
    Bytes changed = s.datagram;
    changed[bit / 8] ^= static_cast<std::uint8_t>(1 << bit % 8);
    EXPECT_EQ(s.open(s.b, 0, changed), Opened::forged) << "bit " << bit;
  }
  EXPECT_EQ(s.open(s.b, 0, s.datagram), Opened::fresh) << "the forged ones changed nothing";
}

TEST(Session, AForgedCounterDoesNotPushOthersOutOfTheWindow) {
  Sealed s;
  s.a.seal(Bytes{1}, s.datagram);
  Bytes far = s.datagram;
  far[6] = 0xFF;
  EXPECT_EQ(s.open(s.b, 0, far), Opened::forged);
  EXPECT_EQ(s.open(s.b, 0, s.datagram), Opened::fresh);
}

}  // namespace
}  // namespace tether::link
