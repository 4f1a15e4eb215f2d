#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <set>
#include <string>

#include "tests/link/two_hosts.hpp"

namespace tether::link {
namespace {

using std::chrono::milliseconds;
using testing::TwoHosts;

#ifndef TETHER_FORGERIES
#define TETHER_FORGERIES 10000000
#endif

std::int64_t from_environment(const char* name, std::int64_t otherwise) {
  const char* const value = std::getenv(name);
  return value == nullptr ? otherwise : std::stoll(value);
}

std::int64_t forgeries() { return from_environment("TETHER_FORGERIES", TETHER_FORGERIES); }

/// The seed of each test; its offset from the environment draws other forgeries.
std::uint64_t seed(std::uint64_t of_test) {
  return of_test + 1000 * static_cast<std::uint64_t>(from_environment("TETHER_FORGERY_SEED", 0));
}

/// Who has recorded all that two hosts ever sent to each other, and sends what he likes.
class Attacker {
 public:
  Attacker(const std::vector<TwoHosts::Datagram>& recorded, std::uint64_t seed)
      : recorded_(recorded), random_(seed) {}

  TwoHosts::Datagram next() {
    TwoHosts::Datagram d = recorded_[below(recorded_.size())];
    switch (below(9)) {
      case 0:
        break;  // replayed
      case 1:
        d.from = 1 - d.from;  // reflected
        break;
      case 2:
        d.path = 1 - d.path;
        break;
      case 3:  // any bytes
        d.bytes.resize(below(200));
        for (std::uint8_t& byte : d.bytes) byte = static_cast<std::uint8_t>(random_());
        break;
      case 4:  // any bytes behind a true header
        for (std::size_t i = 14; i < d.bytes.size(); ++i) {
          d.bytes[i] = static_cast<std::uint8_t>(random_());
        }
        break;
      case 5:
        d.bytes.resize(below(d.bytes.size() + 50), static_cast<std::uint8_t>(random_()));
        break;
      case 6: {  // spliced: the end of another
        const Bytes& other = recorded_[below(recorded_.size())].bytes;
        const std::size_t cut = below(std::min(d.bytes.size(), other.size()));
        d.bytes.resize(cut);
        d.bytes.insert(d.bytes.end(), other.begin() + static_cast<std::ptrdiff_t>(cut),
                       other.end());
        break;
      }
      case 7:  // another counter, near
        if (d.bytes.size() > 14) d.bytes[13] ^= static_cast<std::uint8_t>(1 + below(255));
        [[fallthrough]];
      default:
        for (std::size_t i = 1 + below(3); i-- > 0 && !d.bytes.empty();) {
          d.bytes[below(d.bytes.size())] ^= static_cast<std::uint8_t>(1 << below(8));
        }
    }
    return d;
  }

 private:
  std::size_t below(std::size_t n) { return random_() % n; }

  const std::vector<TwoHosts::Datagram>& recorded_;
  RandomEngine random_;
};

std::int64_t authentic(TwoHosts& net) {
  std::int64_t sum = 0;
  for (const std::size_t host : {0U, 1U}) {
    for (const std::size_t path : {0U, 1U}) sum += net.link(host).report(path, net.now).received;
  }
  return sum;
}

TEST(Forgery, NothingForgedReplayedReflectedOrChangedIsTaken) {
  LinkSettings settings = testing::two_paths();
  settings.rekey.after = std::chrono::seconds{2};
  TwoHosts net(settings);
  net.keep = true;
  for (int i = 0; i < 500; ++i) {  // through several sessions
    net.send(0, i % 10 == 0 ? "BIG" : "CMD", Bytes(i % 10 == 0 ? 4000 : 20, 1));
    net.send(1, "POSE", {2});
    net.run(milliseconds{10});
  }
  net.run(milliseconds{100});
  net.keep = false;
  ASSERT_GE(net.link(0).sessions().count(), 3);
  const std::int64_t before = authentic(net);
  const std::array heard{net.hosts[0].heard.size(), net.hosts[1].heard.size()};
  const std::int64_t sessions = net.link(0).sessions().count() + net.link(1).sessions().count();
  Attacker attacker(net.seen, seed(7));
  std::size_t answered = 0;
  net.loses = [&answered](const TwoHosts::Datagram&) { return ++answered > 0; };
  for (std::int64_t i = forgeries(); i-- > 0;) {
    const TwoHosts::Datagram d = attacker.next();
    // A HELLO or ANSWER that the last handshake used passes for its copy of the other path.
    net.inject(1 - d.from, d.path, d.bytes, testing::host_address(d.from, d.path));
  }
  EXPECT_EQ(authentic(net), before);
  EXPECT_EQ(net.hosts[0].heard.size(), heard[0]);
  EXPECT_EQ(net.hosts[1].heard.size(), heard[1]);
  EXPECT_EQ(net.link(0).sessions().count() + net.link(1).sessions().count(), sessions);
  EXPECT_EQ(answered, 0U) << "and nothing is answered";
  net.loses = [](const TwoHosts::Datagram&) { return false; };
  net.send(0, "CMD", {3});
  net.run(milliseconds{10});
  EXPECT_EQ(net.hosts[1].heard.size(), heard[1] + 1) << "the session lives on";
}

TEST(Forgery, AManInTheMiddleOfLiveTrafficAndOfRestartsChangesAndRepeatsNoMessage) {
  TwoHosts net(testing::two_paths());
  net.keep = true;
  net.connect();
  Attacker attacker(net.seen, seed(11));
  constexpr std::uint32_t kEachRound = 25, kRoundsToRestart = 800;
  const auto rounds = static_cast<std::uint32_t>(forgeries() / 10 / kEachRound);
  for (std::uint32_t round = 0; round < rounds; ++round) {
    net.send(0, "CMD", testing::numbered(round));
    net.send(1, "POSE", testing::numbered(~round));
    net.run(milliseconds{1});
    for (std::uint32_t i = 0; i < kEachRound; ++i) {
      const TwoHosts::Datagram d = attacker.next();
      net.inject(1 - d.from, d.path, d.bytes, testing::host_address(d.from, d.path));
    }
    if (round % kRoundsToRestart == kRoundsToRestart - 1) net.restart(round / kRoundsToRestart % 2);
  }
  net.run(milliseconds{100});
  for (const std::size_t host : {0U, 1U}) {
    std::set<std::uint32_t> numbers;
    for (const TwoHosts::Heard& heard : net.hosts[host].heard) {
      ASSERT_EQ(heard.bytes.size(), 4U);
      const auto number = Reader(heard.bytes).number<std::uint32_t>();
      ASSERT_LT(host == 0 ? ~number : number, rounds) << "was never sent";
      ASSERT_TRUE(numbers.insert(number).second) << "came twice";
    }
    EXPECT_GE(numbers.size(), rounds / 2) << "and it goes on";
  }
}

TEST(Forgery, AfterARestartARecordedHandshakeLeadsNowhere) {
  TwoHosts net(testing::two_paths());
  net.keep = true;
  net.connect();
  for (int i = 0; i < 100; ++i) {
    net.send(0, "CMD", {1});
    net.run(milliseconds{1});
  }
  net.keep = false;
  const std::size_t heard = net.hosts[1].heard.size();
  net.restart(1);
  std::size_t answers = 0, hellos = 0;
  net.loses = [&answers](const TwoHosts::Datagram& d) { return d.from == 1 && ++answers > 0; };
  for (const auto& d : net.seen) {
    if (d.from != 0) continue;
    if (read_hello(d.bytes)) ++hellos;
    net.inject(1, d.path, d.bytes);
  }
  EXPECT_EQ(net.hosts[1].heard.size(), heard);
  EXPECT_EQ(net.link(1).sessions().count(), 0);
  EXPECT_LE(answers, hellos) << "one for each, which is shorter";
  net.loses = [](const TwoHosts::Datagram&) { return false; };
  net.run(std::chrono::seconds{1});
  net.send(0, "CMD", {1});
  net.run(milliseconds{10});
  EXPECT_EQ(net.hosts[1].heard.size(), heard + 1) << "the true peer still gets through";
}

}  // namespace
}  // namespace tether::link
