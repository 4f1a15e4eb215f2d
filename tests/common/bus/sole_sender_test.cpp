#include "common/node/sole_sender.hpp"

#include <gmock/gmock.h>

#include "common/node/virtual_loop.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr std::uint64_t kFirstSender = 11, kSecondSender = 22, kCarol = 33;
constexpr Duration kPeriod = milliseconds{50};

struct SenderWatchTest : ::testing::Test {
  SenderWatch watch;
  Instant now = kStart;

  void hear(std::uint64_t sender, Duration after = kPeriod) {
    now += after;
    watch.heard(now, sender);
  }
  void hear_both(int times) {
    for (int i = 0; i < times; ++i)
      hear(kFirstSender, kPeriod / 2), hear(kSecondSender, kPeriod / 2);
  }
};

TEST_F(SenderWatchTest, OneSenderIsOneForEver) {
  for (int i = 0; i < 1000; ++i) hear(kFirstSender);
  EXPECT_THAT(watch.several(now), IsEmpty());
}

TEST_F(SenderWatchTest, ASenderThatFallsSilentWhenAnotherBeginsHasRestarted) {
  for (const std::uint64_t start : {kFirstSender, kSecondSender, kCarol, kFirstSender}) {
    for (int i = 0; i < 100; ++i) {
      hear(start);
      EXPECT_THAT(watch.several(now), IsEmpty());
    }
  }
}

TEST_F(SenderWatchTest, TheOldOnesLastMessagesMayComeAfterTheNewOnesFirst) {
  hear(kFirstSender);
  hear(kSecondSender);
  hear(kFirstSender, SenderWatch::kOverlap - nanoseconds{1});
  for (int i = 0; i < 100; ++i) {
    hear(kSecondSender);
    EXPECT_THAT(watch.several(now), IsEmpty());
  }
}

TEST_F(SenderWatchTest, TwoAt20HzAreNoticedWithin200Ms) {
  const Instant begin = now;
  for (int i = 0; watch.several(now).empty() && i < 100; ++i) hear_both(1);
  EXPECT_THAT(watch.several(now), ElementsAre(kFirstSender, kSecondSender));
  EXPECT_LE(now - begin, milliseconds{200});
}

TEST_F(SenderWatchTest, TwoAtOneHertzAreNoticedAtTheSecondMessageOfEither) {
  hear(kFirstSender), hear(kSecondSender, milliseconds{500}), hear(kFirstSender, milliseconds{500});
  EXPECT_THAT(watch.several(now), IsEmpty());
  hear(kSecondSender, milliseconds{500});
  EXPECT_THAT(watch.several(now), ElementsAre(kFirstSender, kSecondSender));
}

TEST_F(SenderWatchTest, IsSatisfiedWhenOneOfThemHasBeenSilentForTwoSeconds) {
  hear_both(10);
  const Instant last = now - kPeriod / 2;  // Alice's
  EXPECT_THAT(watch.several(last + SenderWatch::kMemory), ElementsAre(kFirstSender, kSecondSender));
  EXPECT_THAT(watch.several(last + SenderWatch::kMemory + nanoseconds{1}), IsEmpty());
}

TEST_F(SenderWatchTest, DoesNotCountWhoIsUnknown) {
  for (int i = 0; i < 20; ++i) hear(kFirstSender), hear(0);
  EXPECT_THAT(watch.several(now), IsEmpty());
}

TEST_F(SenderWatchTest, AFloodOfSendersDoesNotHideThoseThatGoOn) {
  std::uint64_t other = 1000;
  for (int i = 0; i < 100; ++i) {
    hear_both(1);
    hear(other++, nanoseconds{1});
  }
  EXPECT_THAT(watch.several(now), ElementsAre(kFirstSender, kSecondSender));
}

TEST(SoleSenderTest, WritesSendersAsAddressAndPort) {
  EXPECT_EQ(sender_name(0x0200000a'0001), "10.0.0.2:256");
  EXPECT_EQ(sender_name(0x0001), "this host's port 256");
}

TEST(SoleSenderTest, NamesChannelAndSendersOnceAndThenIsSatisfiedAgain) {
  /// A network that tells who sends.
  struct Telling final : Bus {
    std::vector<Handler> handlers;
    void publish(std::string_view, std::span<const std::uint8_t>) override {}
    void subscribe(const std::string& channel, int, Handler handler) override {
      EXPECT_EQ(channel, "AGV/CMD_VEL");
      handlers.push_back(std::move(handler));
    }
  };
  VirtualLoop loop;
  Telling bus;
  std::vector<std::string> reports;
  SoleSender sole(loop, bus, {"AGV/CMD_VEL"},
                  [&](const std::string& line) { reports.push_back(line); });
  const auto send_each = [&](Instant from, Instant to, std::uint64_t sender) {
    loop.every(from, kPeriod, Priority::node, [&, to, sender](Instant now) {
      if (now < to) bus.handlers.at(0)({"AGV/CMD_VEL", {}, sender});
    });
  };
  // 127.0.0.1:256 and 127.0.0.1:257, as UdpmBus numbers them.
  send_each(kStart, kStart + std::chrono::seconds{10}, 0x0100007f'0001);
  send_each(kStart + std::chrono::seconds{1}, kStart + std::chrono::seconds{2}, 0x0100007f'0101);
  loop.run_until(kStart + std::chrono::seconds{1});
  EXPECT_EQ(sole.trouble(), "");
  loop.run_until(kStart + std::chrono::seconds{2});
  EXPECT_TRUE(sole.several("AGV/CMD_VEL"));
  EXPECT_FALSE(sole.several("AGV/PLAN"));
  EXPECT_EQ(sole.trouble(), "AGV/CMD_VEL: 127.0.0.1:256 and 127.0.0.1:257");
  loop.run_until(kStart + std::chrono::seconds{9});
  EXPECT_EQ(sole.trouble(), "");
  CounterList counters;
  sole.list(counters);
  EXPECT_THAT(counters, ElementsAre(std::pair<std::string, std::int64_t>("senders.several", 1)));
  EXPECT_THAT(reports, ElementsAre("several programs send at the same time on AGV/CMD_VEL: "
                                   "127.0.0.1:256 and 127.0.0.1:257"));
}

}  // namespace
}  // namespace tether
