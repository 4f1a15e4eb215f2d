#include "doors/link/path_fates.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/link/two_hosts.hpp"

namespace tether::link {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::send_numbers;
using testing::two_paths;
using testing::TwoHosts;

constexpr std::uint8_t kSealed = 3;

/// Two hosts, and what really became of host 0's sealed datagrams by each path.
struct Witnessed {
  explicit Witnessed(const LinkSettings& settings) : net(settings) {
    net.loses = [this](const TwoHosts::Datagram& d) {
      if (d.from != 0) return false;
      const bool lost = d.bytes[1] == kSealed && loses(d.path);
      if (d.bytes[1] == kSealed) truth[d.path].push_back(lost);
      return lost;
    };
    net.connect();
  }
  std::vector<Fate> fates(std::size_t path) { return net.link(1).take_fates(path); }

  TwoHosts net;
  std::function<bool(std::size_t path)> loses = [](std::size_t) { return false; };
  std::array<std::vector<bool>, kMostPaths> truth;
};

std::vector<bool> losses(const std::vector<Fate>& fates) {
  std::vector<bool> lost;
  for (const Fate& fate : fates) lost.push_back(!fate.transit_ns);
  return lost;
}

std::int64_t lost_of(const std::vector<bool>& fates) {
  return std::count(fates.begin(), fates.end(), true);
}

TEST(PathFates, OfOnePathAreThoseOfTheNetwork) {
  Witnessed w(LinkSettings{});
  RandomEngine random(4);
  bool bad = false;
  w.loses = [&](std::size_t) {
    bad = uniform_01(random) < (bad ? 0.8 : 0.05);
    return bad;
  };
  send_numbers(w.net, 20'000);
  w.net.run(seconds{3});
  const std::vector<bool> seen = losses(w.fates(0));
  ASSERT_GT(seen.size(), 20'000U);
  ASSERT_LE(seen.size(), w.truth[0].size());
  EXPECT_EQ(seen, std::vector<bool>(w.truth[0].begin(),
                                    w.truth[0].begin() + static_cast<long>(seen.size())));
  std::int64_t bursts = 0, longest = 0, run = 0;
  for (const bool lost : seen) {
    bursts += !lost && run > 0 ? 1 : 0;
    run = lost ? run + 1 : 0;
    longest = std::max(longest, run);
  }
  EXPECT_EQ(w.net.link(1).bursts(0).count, bursts);
  EXPECT_EQ(w.net.link(1).bursts(0).longest, longest);
}

TEST(PathFates, OfTwoPathsHaveTheRightNumberOfLossesAndRarelyTheWrongOne) {
  Witnessed w(two_paths());
  RandomEngine random(5);
  constexpr std::array<double, 2> kLoss{0.3, 0.1};
  w.loses = [&](std::size_t path) { return uniform_01(random) < kLoss[path]; };
  send_numbers(w.net, 20'000);
  w.net.run(seconds{3});
  for (const std::size_t path : {0U, 1U}) {
    const std::vector<bool> seen = losses(w.fates(path));
    ASSERT_GT(seen.size(), 20'000U);
    const std::vector<bool> truth(w.truth[path].begin(),
                                  w.truth[path].begin() + static_cast<long>(seen.size()));
    EXPECT_EQ(lost_of(seen), lost_of(truth)) << "path " << path;
    // Where the PROBEs of both paths are lost, 3 % of 4 a second: one lost datagram at most is
    // taken for another, which shifts those between by one.
    double wrong = 0.0;
    for (std::size_t i = 0; i < seen.size(); ++i) wrong += seen[i] != truth[i] ? 1.0 : 0.0;
    EXPECT_LT(wrong / static_cast<double>(seen.size()), 0.03 * 0.42) << "path " << path;
  }
}

TEST(PathFates, ADeadPathHasLostAllAndTheOtherNothing) {
  Witnessed w(two_paths());
  send_numbers(w.net, 2000);
  w.loses = [&](std::size_t path) { return path == 1; };
  send_numbers(w.net, 10'000);
  w.loses = [](std::size_t) { return false; };
  send_numbers(w.net, 3000);
  w.net.run(seconds{3});
  EXPECT_EQ(lost_of(losses(w.fates(0))), 0);
  const std::vector<bool> seen = losses(w.fates(1));
  EXPECT_EQ(lost_of(seen), lost_of(w.truth[1]));
  EXPECT_EQ(w.net.link(1).bursts(1).count, 1);
  EXPECT_EQ(w.net.link(1).bursts(1).longest, lost_of(w.truth[1]));
}

TEST(PathFates, ADeadPathIsKnownToBeWhileItIs) {
  Witnessed w(two_paths());
  send_numbers(w.net, 2000);
  w.fates(1);
  w.loses = [&](std::size_t path) { return path == 1; };
  send_numbers(w.net, 10'000);
  const std::int64_t lost = lost_of(losses(w.fates(1)));
  EXPECT_GT(lost, 7000);
  EXPECT_LE(lost, lost_of(w.truth[1]));
}

TEST(PathFates, HaveTheTimesOfSendingAndTheDelays) {
  TwoHosts net;
  net.hosts[0].clock_ahead_ns = 5'000'000;
  net.connect();
  int number = 0;
  net.delay = [&](const TwoHosts::Datagram&) { return milliseconds{2 + number++ % 5}; };
  send_numbers(net, 3000);
  net.run(seconds{2});
  const std::vector<Fate> fates = net.link(1).take_fates(0);
  ASSERT_GT(fates.size(), 3000U);
  EXPECT_TRUE(fates[0].after_gap);
  for (std::size_t i = 1; i < fates.size(); ++i) {
    EXPECT_FALSE(fates[i].after_gap);
    EXPECT_GE(fates[i].sent_ns, fates[i - 1].sent_ns);
    ASSERT_TRUE(fates[i].transit_ns);
    EXPECT_GE(*fates[i].transit_ns, -3'000'000) << "2 to 7 ms, less the 5 by which we are behind";
    EXPECT_LE(*fates[i].transit_ns, 2'000'000);
  }
}

TEST(PathFates, NewKeysLeaveGapsThatAreNamed) {
  LinkSettings settings;
  settings.rekey.after = seconds{10};
  Witnessed w(settings);
  send_numbers(w.net, 25'000);
  w.net.run(seconds{2});
  const std::vector<Fate> fates = w.fates(0);
  const auto gaps =
      std::count_if(fates.begin(), fates.end(), [](const Fate& f) { return f.after_gap; });
  EXPECT_GE(gaps, 3);
  EXPECT_LE(gaps, w.net.link(1).sessions().count());
  EXPECT_EQ(lost_of(losses(fates)), 0) << "what is not known is not lost";
}

TEST(PathFates, OfAPeerThatDefersCopiesAreNotTold) {
  LinkSettings settings = two_paths();
  settings.second_after = milliseconds{20};
  Witnessed w(settings);
  send_numbers(w.net, 3000);
  w.net.run(seconds{2});
  EXPECT_LE(w.fates(0).size(), 10U) << "but for PROBEs before the first message";
}

TEST(PathFates, WildCountersOfAPeerDoNoHarm) {
  PathFates fates(2);
  RandomEngine random(1);
  Instant now = kStart;
  for (int i = 0; i < 20'000; ++i) {
    const std::uint64_t counter = random() >> (random() % 64);
    const std::size_t path = random() % 2;
    fates.on_received(path, 1 + random() % 3, counter, static_cast<std::int64_t>(random()), 0,
                      random() % 2 == 0);
    fates.on_probe(now, path, 1 + random() % 3, counter, random() >> (random() % 64));
    now += milliseconds{random() % 500};
  }
  EXPECT_LE(fates.take(0).size(), PathFates::kMostFates);
}

}  // namespace
}  // namespace tether::link
