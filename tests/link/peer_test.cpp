#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <set>
#include <utility>

#include "tests/link/two_hosts.hpp"

namespace tether::link {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::key_number;
using testing::numbered;
using testing::numbers_heard;
using testing::send_numbers;
using testing::two_paths;
using testing::TwoHosts;

TEST(PeerLink, CarriesMessagesBothWays) {
  TwoHosts net;
  net.connect();
  net.send(0, "CMD", {1, 2, 3});
  net.send(1, "POSE", {4});
  net.run(milliseconds{10});
  ASSERT_EQ(net.hosts[1].heard.size(), 1U);
  EXPECT_EQ(net.hosts[1].heard[0].channel, "CMD");
  EXPECT_EQ(net.hosts[1].heard[0].bytes, (Bytes{1, 2, 3}));
  ASSERT_EQ(net.hosts[0].heard.size(), 1U);
  EXPECT_EQ(net.refused(0).sum() + net.refused(1).sum(), 0);
}

TEST(PeerLink, CarriesEmptyAndLongMessages) {
  TwoHosts net(two_paths());
  net.connect();
  Bytes big(300'000);
  for (std::size_t i = 0; i < big.size(); ++i) big[i] = static_cast<std::uint8_t>(i * 7);
  net.send(0, "BIG", big);
  net.send(0, "BIG", {});
  net.run(milliseconds{100});
  ASSERT_EQ(net.hosts[1].heard.size(), 2U);
  EXPECT_EQ(net.hosts[1].heard[0].bytes, big);
  EXPECT_TRUE(net.hosts[1].heard[1].bytes.empty());
}

TEST(PeerLink, NoDatagramIsLongerThanThePathCarries) {
  LinkSettings settings;
  settings.datagram_bytes = kSmallestDatagram;
  TwoHosts net(settings);
  net.keep = true;
  net.connect();
  for (const std::size_t size : {500U, 503U, 504U, 505U, 3000U}) net.send(0, "BIG", Bytes(size, 1));
  net.run(milliseconds{50});
  EXPECT_EQ(net.hosts[1].heard.size(), 5U);
  std::size_t longest = 0;
  for (const auto& datagram : net.seen) longest = std::max(longest, datagram.bytes.size());
  EXPECT_EQ(longest, kSmallestDatagram);
}

TEST(PeerLink, NoticesAPathThatDropsLongDatagrams) {
  TwoHosts net(two_paths());
  net.connect();
  net.run(seconds{15});
  EXPECT_TRUE(net.link(0).carries_long(0) && net.link(0).carries_long(1));
  net.loses = [](const TwoHosts::Datagram& d) { return d.path == 1 && d.bytes.size() > 1000; };
  net.run(seconds{12});
  EXPECT_TRUE(net.link(0).carries_long(1)) << "may yet be losses";
  net.run(seconds{3});
  EXPECT_TRUE(net.link(0).carries_long(0));
  EXPECT_FALSE(net.link(0).carries_long(1));
  EXPECT_TRUE(net.link(0).alive(1, net.now));
  net.loses = [](const TwoHosts::Datagram&) { return false; };
  net.run(seconds{1});
  EXPECT_TRUE(net.link(0).carries_long(1));
}

TEST(PeerLink, MeasuresClocksThatAreSetApartWhileASessionLives) {
  TwoHosts net;
  net.connect();
  net.hosts[1].clock_ahead_ns = 73'000'000'000;
  net.run(seconds{2});
  EXPECT_NEAR(nearest_to_zero_s(net.link(0).offset(net.now).value()), 73.0, 0.01);
  EXPECT_NEAR(nearest_to_zero_s(net.link(1).offset(net.now).value()), -73.0, 0.01);
}

TEST(PeerLink, TakesNoMessagesForATimeWhileTheClocksAreTooFarApart) {
  TwoHosts net;
  net.connect();
  const auto taken = [&net](std::int64_t apart_ms) {
    net.hosts[1].clock_ahead_ns = apart_ms * 1'000'000;
    net.run(seconds{40});  // the interval forgets what was before a step
    net.hosts[1].heard.clear();
    for (const char* channel : {"CMD", "BIG"}) net.send(0, channel, {1});
    net.run(milliseconds{10});
    std::vector<std::string> channels;
    for (const auto& heard : net.hosts[1].heard) channels.push_back(heard.channel);
    return channels;
  };
  EXPECT_EQ(taken(150), (std::vector<std::string>{"CMD", "BIG"}));
  EXPECT_EQ(taken(-300), (std::vector<std::string>{"CMD"}));
  EXPECT_EQ(net.link(1).counters().clock_refused, 1);
  EXPECT_EQ(taken(0), (std::vector<std::string>{"CMD", "BIG"}));
}

TEST(PeerLink, SendsOnlyWhatARuleNames) {
  TwoHosts net;
  net.connect();
  net.send(0, "OTHER", {1});
  net.run(milliseconds{10});
  EXPECT_EQ(net.link(0).counters().sent, 0);
}

TEST(PeerLink, TakesOnlyWhatThePeerMaySend) {
  TwoHosts net;
  net.connect();
  net.send(1, "SECRET", {1});
  net.run(milliseconds{10});
  EXPECT_TRUE(net.hosts[0].heard.empty());
  EXPECT_EQ(net.link(0).counters().not_allowed, 1);
}

TEST(PeerLink, NoPeerSpeaksForTheLinkItself) {
  TwoHosts net;
  net.connect();
  net.send(1, "FAKE", {1});  // which its rule makes LINK/REPORT, and ours lets in
  net.run(milliseconds{10});
  EXPECT_TRUE(net.hosts[0].heard.empty());
  EXPECT_EQ(net.link(0).counters().not_allowed, 1);
}

TEST(PeerLink, AFloodOfForgedAnswersDoesNotEvenDelayAHandshake) {
  TwoHosts net;
  net.knows_address = {true, false};
  net.restart(1);
  bool flooded = false;
  net.loses = [&](const TwoHosts::Datagram& d) {
    const auto hello = read_hello(d.bytes);
    if (hello && !flooded) {
      flooded = true;
      Bytes forged = to_bytes(Answer{hello->session, 5, 6, hello->ephemeral, {}});
      forged.resize(kAnswerBytes);
      for (int i = 0; i < 1000; ++i) net.inject(0, 0, forged);
    }
    return false;
  };
  net.connect();
  EXPECT_EQ(net.refused(0).forged, 1000);
  EXPECT_EQ(net.link(0).sessions().count(), 1);
}

TEST(PeerLink, BothSidesSettleOnOneSessionWhenBothBegin) {
  TwoHosts net(two_paths());
  net.keep = true;
  net.connect();
  net.run(seconds{1});
  net.seen.clear();
  net.run(seconds{1});
  std::set<std::uint32_t> sessions;
  for (const auto& datagram : net.seen) {
    if (datagram.from == 0) sessions.insert(read_sealed_header(datagram.bytes)->session);
  }
  EXPECT_EQ(sessions.size(), 1U);
  EXPECT_EQ(net.refused(0).sum() + net.refused(1).sum(), 0);
}

TEST(PeerLink, LatestOnlyMessagesGoOnWhenLossesAtTheStartLeaveEachSideWithAnotherSession) {
  TwoHosts net({}, 4);
  ASSERT_LT(net.hosts[1].keys.public_key, net.hosts[0].keys.public_key);
  // Host 1 starts while host 0 calls, and its first PROBE alone is lost.
  bool out = true;
  int lost = 1;
  net.loses = [&](const TwoHosts::Datagram& d) {
    return out || (d.from == 1 && read_sealed_header(d.bytes) && lost-- > 0);
  };
  net.delay = [](const TwoHosts::Datagram&) { return milliseconds{20}; };
  net.run(milliseconds{7470});
  net.restart(1);
  out = false;
  net.run(milliseconds{60});
  net.send(1, "POSE", {1});
  net.run(milliseconds{15});
  net.send(0, "LATEST", {1});
  net.run(milliseconds{55});
  for (int i = 0; i < 100; ++i) {
    net.send(0, "LATEST", {1});
    net.send(1, "POSE", {1});
    net.run(milliseconds{50});
  }
  EXPECT_GE(net.hosts[1].heard.size(), 98U);
  EXPECT_LE(net.link(1).counters().superseded, 2);
  EXPECT_GT(net.link(1).take_fates(0).size(), 50U);
  EXPECT_EQ(net.link(0).sessions().count(), 3) << "new keys have ended it";
}

TEST(PeerLink, ForgedAnswersToEachHelloDelayNothing) {
  LinkSettings settings;
  settings.rekey.after = seconds{60};
  TwoHosts net(settings);
  net.loses = [&](const TwoHosts::Datagram& d) {
    const auto hello = read_hello(d.bytes);
    Bytes answer = to_bytes(Answer{hello ? hello->session : 0, 5, 6, key_number(7), {}});
    answer.resize(kAnswerBytes);
    for (int i = 0; hello && i < 16; ++i) net.inject(d.from, d.path, answer);
    return false;
  };
  net.connect();
  for (int i = 0; i < 3000; ++i) {  // 5 minutes
    net.send(0, "CMD", {1});
    net.run(milliseconds{100});
  }
  EXPECT_EQ(net.hosts[1].heard.size(), 3000U);
  EXPECT_GT(net.refused(0).forged + net.refused(1).forged, 50);
}

TEST(PeerLink, RenewsKeysWithoutLosingAMessage) {
  LinkSettings settings = two_paths();
  settings.rekey.after = seconds{1};
  TwoHosts net(settings);
  net.connect();
  send_numbers(net, 10'000);
  EXPECT_GE(net.link(0).sessions().count(), 9);
  EXPECT_EQ(numbers_heard(net).size(), 10'000U);
  EXPECT_EQ(net.link(0).counters().unsent, 0);
}

TEST(PeerLink, RenewsKeysAfterSoManyDatagrams) {
  LinkSettings settings;
  settings.rekey.datagrams = 100;
  TwoHosts net(settings);
  net.connect();
  send_numbers(net, 1000);
  EXPECT_GE(net.link(0).sessions().count(), 5);
  EXPECT_EQ(numbers_heard(net).size(), 1000U);
}

TEST(PeerLink, ComesBackWhenEitherHostHasRestarted) {
  for (const std::size_t host : {0U, 1U}) {
    TwoHosts net(two_paths());
    net.connect();
    net.restart(host);
    net.run(seconds{1});
    send_numbers(net, 100);
    EXPECT_EQ(numbers_heard(net).size(), 100U) << "host " << host;
  }
}

TEST(PeerLink, ComesBackWhenOnlyTheOtherSideKnowsWhereToSend) {
  TwoHosts net(two_paths());
  net.knows_address = {true, false};
  net.restart(1);
  net.connect();
  net.restart(1);  // which cannot call, and has forgotten the session
  net.run(seconds{9});
  net.send(1, "POSE", {1});
  net.run(milliseconds{10});
  EXPECT_EQ(net.hosts[0].heard.size(), 1U);
}

TEST(PeerLink, ReportsItsOwnClockDifferenceWithinTheInterval) {
  TwoHosts net(two_paths());
  net.hosts[1].clock_ahead_ns = 250'000'000;
  net.delay = [](const TwoHosts::Datagram& d) {  // 3 ms there by path 0, 30 ms back; path 1: 10 ms
    return d.path == 1 ? milliseconds{10} : d.from == 0 ? milliseconds{3} : milliseconds{30};
  };
  net.run(seconds{5});
  const IntervalNs offset = net.link(0).offset(net.now).value();
  EXPECT_LE(offset.min_ns, 250'000'000);
  EXPECT_GE(offset.max_ns, 250'000'000);
  // The fastest each way: 3 ms there by path 0, 10 ms back by path 1.
  EXPECT_NEAR(static_cast<double>(offset.max_ns - offset.min_ns), 13e6, 0.3e6);
  const PathReport report = net.link(0).report(0, net.now);
  EXPECT_EQ(report.round_trip_min_ns, 33'000'000);
  EXPECT_EQ(*report.transit_min_ns + 250'000'000, 30'000'000);
}

TEST(PeerLink, RefusesAHelloOfAnotherTime) {
  for (const std::int64_t apart_s : {-61, 61}) {
    TwoHosts net;
    net.hosts[1].clock_ahead_ns = apart_s * 1'000'000'000;
    net.run(seconds{2});
    EXPECT_EQ(net.link(0).sessions().count(), 0);
    EXPECT_GE(net.refused(0).clock, 1);
    EXPECT_NEAR(static_cast<double>(net.link(0).sessions().clock_ahead_ns()) * 1e-9,
                static_cast<double>(apart_s), 0.01);
  }
  TwoHosts net;
  net.hosts[1].clock_ahead_ns = 59'000'000'000;
  net.run(seconds{2});
  EXPECT_GE(net.link(0).sessions().count(), 1);
}

TEST(PeerLink, UnknownSendersGetNoAnswer) {
  TwoHosts net;
  net.peer_key[0] = key_pair_of(testing::key_number(77)).public_key;
  net.restart(0);  // it calls another host, under a key that host 1 knows; host 1 calls it
  net.keep = true;
  net.run(seconds{5});
  EXPECT_EQ(net.link(1).sessions().count(), 0);
  EXPECT_GE(net.refused(1).forged, 1);
  EXPECT_GE(net.refused(0).unknown_key, 1);
  for (const auto& datagram : net.seen) EXPECT_TRUE(read_hello(datagram.bytes));
}

TEST(PeerLink, RefusesWhatDoesNotComeFromThePeersAddress) {
  TwoHosts net;
  net.keep = true;
  net.connect();
  net.loses = [](const TwoHosts::Datagram&) { return true; };
  net.send(0, "CMD", {1});
  const Bytes captured = net.seen.back().bytes;
  net.inject(1, 0, captured, Address{0x0A000099, 7700});
  EXPECT_TRUE(net.hosts[1].heard.empty());
  EXPECT_EQ(net.refused(1).address, 1);
}

TEST(PeerLink, AReplayFromElsewhereDoesNotMoveALearnedAddress) {
  TwoHosts net;
  net.knows_address = {true, false};
  net.restart(1);
  net.keep = true;
  net.connect();
  net.send(0, "CMD", {1});
  net.run(milliseconds{10});
  for (const auto& datagram : net.seen) {
    if (datagram.from == 0) net.inject(1, 0, datagram.bytes, Address{0x0A000099, 7700});
  }
  net.send(1, "POSE", {1});
  net.run(milliseconds{10});
  EXPECT_EQ(net.hosts[0].heard.size(), 1U);
}

TEST(PeerLink, AProbeThatComesLateDoesNotMoveALearnedAddress) {
  TwoHosts net;
  net.knows_address = {false, true};
  net.restart(0);
  net.connect();
  std::optional<Bytes> held;
  net.loses = [&](const TwoHosts::Datagram& d) {
    if (held || d.from != 1) return false;
    held = d.bytes;
    return true;
  };
  net.run(seconds{1});
  ASSERT_TRUE(held);
  net.inject(0, 0, *held, Address{0x0A0000FF, 7700});
  net.send(0, "CMD", {1});
  net.run(milliseconds{10});
  EXPECT_EQ(net.hosts[1].heard.size(), 1U);
}

/// Copies of all that host 0 sends, 5 ms faster and from elsewhere.
void let_a_faster_observer_copy(TwoHosts& net, Duration time) {
  net.keep = true;
  for (const Instant end = net.now + time; net.now < end;) {
    net.seen.clear();
    net.run(milliseconds{2});
    for (const TwoHosts::Datagram& d : std::vector(net.seen)) {
      if (d.from == 0) net.inject(1, d.path, d.bytes, Address{0x0A000099, 7700});
    }
  }
}

TEST(PeerLink, AFasterObserverDoesNotTakeALearnedPath) {
  TwoHosts net;
  net.knows_address = {true, false};
  net.restart(1);
  net.delay = [](const TwoHosts::Datagram&) { return milliseconds{7}; };
  net.connect();
  for (int i = 0; i < 400; ++i) {
    net.send(1, "POSE", numbered(static_cast<std::uint32_t>(i)));
    let_a_faster_observer_copy(net, milliseconds{10});
  }
  net.run(milliseconds{20});
  EXPECT_EQ(net.hosts[0].heard.size(), 400U);
}

TEST(PeerLink, ALearnedAddressMovesOnceTheOldOneIsSilentAndTheNewOneAnswers) {
  TwoHosts net;
  net.knows_address = {true, false};
  net.restart(1);
  net.connect();
  net.run(seconds{2});
  net.port[0] = 9900;  // like a NAT that has forgotten
  const auto heard_after = [&](Duration time) {
    net.run(time);
    const std::size_t before = net.hosts[0].heard.size();
    net.send(1, "POSE", {1});
    net.run(milliseconds{10});
    return net.hosts[0].heard.size() > before;
  };
  EXPECT_FALSE(heard_after(milliseconds{500}));
  EXPECT_TRUE(heard_after(milliseconds{1500}));
}

TEST(PeerLink, AnAddressThatAnswersNoProbeIsNotMovedTo) {
  TwoHosts net;
  net.knows_address = {true, false};
  net.restart(1);
  net.connect();
  net.keep = true;
  net.loses = [](const TwoHosts::Datagram& d) { return d.from == 0; };
  for (int i = 0; i < 300; ++i) {  // all that it sends comes from elsewhere only
    net.seen.clear();
    net.run(milliseconds{10});
    for (const TwoHosts::Datagram& d : std::vector(net.seen)) {
      if (d.from == 0) net.inject(1, d.path, d.bytes, Address{0x0A000099, 7700});
    }
  }
  net.send(1, "POSE", {1});
  net.run(milliseconds{10});
  EXPECT_EQ(net.hosts[0].heard.size(), 1U);
}

TEST(PeerLink, RecordedHellosDoNotDelayASessionAfterARestart) {
  TwoHosts net;
  net.knows_address = {true, false};
  net.restart(1);
  net.keep = true;
  for (int i = 0; i < 10; ++i) {  // ten of its HELLOs
    net.restart(0);
    net.run(milliseconds{300});
  }
  std::vector<Bytes> recorded;
  for (const TwoHosts::Datagram& d : net.seen) {
    if (d.from == 0 && read_hello(d.bytes)) recorded.push_back(d.bytes);
  }
  ASSERT_GE(recorded.size(), 10U);
  net.restart(1);
  net.restart(0);
  const Instant begun = net.now;
  while (!net.link(1).up(net.now) && net.now - begun < seconds{10}) {
    net.seen.clear();
    net.run(milliseconds{1});
    const auto answers = std::count_if(net.seen.begin(), net.seen.end(), [](const auto& d) {
      return d.from == 1 && read_answer(d.bytes).has_value();
    });
    if (answers > 0 && !recorded.empty()) {
      net.inject(1, 0, recorded.back());
      recorded.pop_back();
    }
  }
  EXPECT_LT(net.now - begun, milliseconds{100});
}

TEST(PeerLink, PathsInAnotherOrderAreNoticed) {
  TwoHosts net(two_paths());
  net.keep = true;
  net.connect();
  net.loses = [](const TwoHosts::Datagram&) { return true; };
  net.seen.clear();
  net.run(milliseconds{260});
  for (const auto& datagram : net.seen) {
    if (datagram.from == 0)
      net.inject(1, 1 - datagram.path, datagram.bytes, testing::host_address(0, 1 - datagram.path));
  }
  EXPECT_EQ(net.refused(1).crossed, 2);
}

TEST(PeerLink, OfLatestOnlyChannelsTheOldDoesNotFollowTheNew) {
  TwoHosts net;
  net.connect();
  net.delay = [&net](const TwoHosts::Datagram&) {  // each is overtaken by the next
    return net.now < kStart + milliseconds{201} ? milliseconds{20} : milliseconds{2};
  };
  net.send(0, "LATEST", numbered(1));
  net.send(0, "CMD", numbered(1));
  net.run(milliseconds{5});
  net.send(0, "LATEST", numbered(2));
  net.run(milliseconds{100});
  std::vector<std::string> order;
  for (const auto& heard : net.hosts[1].heard) {
    order.push_back(heard.channel + std::to_string(heard.bytes[3]));
  }
  EXPECT_EQ(order, (std::vector<std::string>{"LATEST2", "CMD1"}));
  EXPECT_EQ(net.link(1).counters().superseded, 1);
}

TEST(PeerLink, GivesUpMessagesWhosePiecesAreMissing) {
  TwoHosts net;
  net.connect();
  int n = 0;
  net.loses = [&n](const TwoHosts::Datagram& d) { return d.from == 0 && ++n == 2; };
  net.send(0, "BIG", Bytes(5000, 1));
  net.run(milliseconds{50});
  EXPECT_TRUE(net.hosts[1].heard.empty());
  for (int i = 0; i < 40; ++i) {
    net.send(0, "BIG", Bytes(5000, 2));
    net.run(milliseconds{50});
  }
  EXPECT_EQ(net.hosts[1].heard.size(), 40U);
  EXPECT_EQ(net.link(1).incomplete(), 1);
}

TEST(PeerLink, SendsNothingBeforeThereIsASession) {
  TwoHosts net;
  net.send(0, "CMD", {1});
  EXPECT_EQ(net.link(0).counters().unsent, 1);
}

}  // namespace
}  // namespace tether::link
