#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "tests/link/two_hosts.hpp"

namespace tether::link {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::numbered;
using testing::numbers_heard;
using testing::send_numbers;
using testing::two_paths;
using testing::TwoHosts;

LinkSettings deferred(Duration after) {
  LinkSettings settings = two_paths();
  settings.second_after = after;
  return settings;
}

/// Host 0 sends `count` numbered messages, one each millisecond. Which of them host 1 heard; none
/// comes twice.
std::set<std::uint32_t> heard_of(TwoHosts& net, std::uint32_t count) {
  send_numbers(net, count);
  net.run(milliseconds{200});
  return numbers_heard(net);
}

double share_lost(TwoHosts& net, std::uint32_t count) {
  return 1.0 - static_cast<double>(heard_of(net, count).size()) / count;
}

/// 4.5 standard deviations of a share p of n: 1 in 150 000 is farther off by chance.
double tolerance(double p, double n, double variance_inflation = 1.0) {
  return 4.5 * std::sqrt(p * (1.0 - p) / n * variance_inflation);
}

TEST(TwoPaths, IndependentOnesLoseTheProductOfTheirLosses) {
  constexpr std::uint32_t kCount = 40'000;
  constexpr std::array<double, 2> kLoss{0.55, 0.2};
  TwoHosts net(two_paths());
  net.connect();
  RandomEngine random(11);
  net.loses = [&](const TwoHosts::Datagram& d) {
    return d.from == 0 && uniform_01(random) < kLoss[d.path];
  };
  const double expected = kLoss[0] * kLoss[1];
  EXPECT_NEAR(share_lost(net, kCount), expected, tolerance(expected, kCount));
}

/// A Gilbert channel on the clock of the network: mean sojourns, and all is lost in its bad state.
struct Gilbert {
  double good_ms, bad_ms;
  RandomEngine random;
  bool bad = false;
  Instant until = kStart;

  bool loses(Instant now) {
    while (until <= now) {
      bad = !bad;
      const double mean_ms = bad ? bad_ms : good_ms;
      until += from_seconds(-mean_ms * 1e-3 * std::log1p(-uniform_01(random)));
    }
    return bad;
  }
  double share_bad() const { return bad_ms / (good_ms + bad_ms); }
  /// Variance inflation of the mean of n samples, one each millisecond: autocorrelation ρ^k with ρ
  /// = exp(−1/g − 1/b).
  double variance_inflation() const {
    const double rho = std::exp(-1.0 / good_ms - 1.0 / bad_ms);
    return (1.0 + rho) / (1.0 - rho);
  }
};

TEST(TwoPaths, ThatShareAllTheirFadesGainNothing) {
  constexpr std::uint32_t kCount = 60'000;
  const auto lost_by = [](std::size_t paths) {
    LinkSettings settings;
    settings.paths = paths;
    TwoHosts net(settings);
    net.connect();
    Gilbert channel{40.0, 10.0, RandomEngine(5)};
    channel.until = net.now;
    net.loses = [&](const TwoHosts::Datagram& d) { return d.from == 0 && channel.loses(net.now); };
    const double lost = share_lost(net, kCount);
    EXPECT_NEAR(lost, channel.share_bad(),
                tolerance(channel.share_bad(), kCount, channel.variance_inflation()));
    return lost;
  };
  EXPECT_EQ(lost_by(1), lost_by(2)) << "of the same fades";
}

TEST(TwoPaths, NoMessageIsMissedWhenEitherIsPulled) {
  for (const LinkSettings& settings : {two_paths(), deferred(milliseconds{20})}) {
    for (const std::size_t pulled : {0U, 1U}) {
      TwoHosts net(settings);
      net.connect();
      const Instant when = net.now + seconds{2};
      net.loses = [&](const TwoHosts::Datagram& d) { return d.path == pulled && net.now >= when; };
      EXPECT_EQ(heard_of(net, 6000).size(), 6000U) << "path " << pulled;
      EXPECT_FALSE(net.link(1).alive(pulled, net.now));
      EXPECT_TRUE(net.link(1).alive(1 - pulled, net.now));
      EXPECT_TRUE(net.link(1).up(net.now));
    }
  }
}

TEST(TwoPaths, NoMessageIsMissedWhenThePulledOneComesBackAndTheOtherGoes) {
  TwoHosts net(two_paths());
  net.connect();
  net.loses = [&](const TwoHosts::Datagram& d) {
    const auto second = static_cast<std::size_t>(to_seconds(net.now));
    return second >= 1 && d.path == second % 2;
  };
  EXPECT_EQ(heard_of(net, 6000).size(), 6000U);
}

TEST(TwoPaths, TheAddressOfASlowerOneIsLearnedWhateverComesByTheOther) {
  TwoHosts net(two_paths());
  net.knows_address = {false, true};
  net.restart(0);
  bool pulled = false;
  net.delay = [](const TwoHosts::Datagram& d) { return milliseconds{d.path == 0 ? 2 : 40}; };
  net.loses = [&](const TwoHosts::Datagram& d) { return pulled && d.path == 0; };
  net.connect();
  for (int i = 0; i < 600; ++i) {
    pulled = i >= 300;
    net.send(1, "POSE", numbered(0));
    net.send(0, "CMD", numbered(static_cast<std::uint32_t>(i)));
    net.run(milliseconds{10});
  }
  net.run(milliseconds{100});
  EXPECT_EQ(numbers_heard(net).size(), 600U);
}

TEST(TwoPaths, LossOfEachIsReported) {
  TwoHosts net(two_paths());
  net.connect();
  RandomEngine random(2);
  net.loses = [&](const TwoHosts::Datagram& d) {
    return d.from == 0 && d.path == 1 && uniform_01(random) < 0.3;
  };
  heard_of(net, 6000);
  const PathReport good = net.link(1).report(0, net.now), bad = net.link(1).report(1, net.now);
  EXPECT_EQ(good.lost, 0);
  EXPECT_EQ(good.recent_loss, 0.0);
  EXPECT_NEAR(bad.recent_loss, 0.3, tolerance(0.3, 4500));
  EXPECT_NEAR(static_cast<double>(bad.lost) / 6000.0, 0.3, tolerance(0.3, 6000));
  EXPECT_GT(good.first, 4000) << "what came by both at once counts for the first of them";
}

TEST(DeferredCopies, AreSentForWhatIsLostAndNothingElse) {
  constexpr std::uint32_t kCount = 20'000;
  TwoHosts net(deferred(milliseconds{20}));
  net.connect();
  RandomEngine random(3);
  net.loses = [&](const TwoHosts::Datagram& d) {
    return d.from == 0 && d.path == 0 && uniform_01(random) < 0.1;
  };
  EXPECT_EQ(heard_of(net, kCount).size(), kCount) << "the second path loses nothing";
  const PeerCounters& c = net.link(0).counters();
  EXPECT_EQ(c.copies + c.copies_saved, kCount);
  EXPECT_NEAR(static_cast<double>(c.copies) / kCount, 0.1, tolerance(0.1, kCount));
}

TEST(DeferredCopies, GoOutWhenTheirTimeHasCome) {
  TwoHosts net(deferred(milliseconds{20}));
  net.connect();
  net.run(seconds{1});
  net.loses = [](const TwoHosts::Datagram& d) { return d.from == 0 && d.path == 0; };
  const Instant sent = net.now;
  net.send(0, "CMD", numbered(1));
  net.run(milliseconds{100});
  ASSERT_EQ(net.hosts[1].heard.size(), 1U);
  const double after_ms = to_milliseconds(net.hosts[1].heard[0].when - sent);
  EXPECT_GE(after_ms, 22.0);
  EXPECT_LE(after_ms, 23.5) << "ticks are 1 ms apart, the path takes 2 ms";
}

TEST(DeferredCopies, OfLatestOnlyChannelsAreDroppedForNewerMessages) {
  TwoHosts net(deferred(milliseconds{20}));
  net.connect();
  net.run(seconds{1});
  net.loses = [](const TwoHosts::Datagram& d) { return d.from == 0 && d.path == 0; };
  for (std::uint32_t i = 0; i < 5; ++i) {
    net.send(0, "LATEST", numbered(i));
    net.run(milliseconds{5});
  }
  net.run(milliseconds{100});
  ASSERT_EQ(net.hosts[1].heard.size(), 1U);
  EXPECT_EQ(net.hosts[1].heard[0].bytes, numbered(4));
}

TEST(TwoPaths, ASlowSecondPathDeliversNothingTwiceAndNothingOldOfLatestOnly) {
  TwoHosts net(two_paths());
  net.delay = [](const TwoHosts::Datagram& d) {
    return d.path == 0 ? milliseconds{2} : seconds{3};
  };
  net.connect();
  for (std::uint32_t i = 0; i < 5000; ++i) {  // more than the replay window
    net.send(0, "LATEST", numbered(i));
    net.run(milliseconds{1});
  }
  net.run(seconds{4});
  EXPECT_EQ(net.hosts[1].heard.size(), 5000U);
  EXPECT_GT(net.refused(1).late, 1000);
}

}  // namespace
}  // namespace tether::link
