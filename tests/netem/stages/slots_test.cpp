#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <set>
#include <vector>

#include "tests/netem/stages/stage_rig.hpp"
#include "tests/support/virtual_world.hpp"

// Slotted release. Tolerances of samples: 5 standard deviations.

namespace tether {
namespace {

using test::at_ms;
using test::link_with;
using ::testing::ElementsAre;

constexpr double kSlotSigmas = 5.0;

Packet byte_packet() { return {"X", {1}}; }

double slot_ms(Instant t) { return to_milliseconds(t - kStart); }

void drop_ready(Link& link, Instant now) {
  link.pop_ready(now, [](const Packet&) {});
}

TEST(LinkSlots, ReleaseAtMultiplesOfThePeriod) {
  Link link = link_with({"slot.period_ms=100"});
  std::vector<double> leaves;
  for (const double t : {-150.0, -100.0, 0.0, 0.000001, 99.0, 100.0, 250.0}) {
    leaves.push_back(slot_ms(link.push(at_ms(t), byte_packet())));
  }
  EXPECT_THAT(leaves, ElementsAre(-100.0, -100.0, 0.0, 100.0, 100.0, 100.0, 300.0));
}

TEST(LinkSlots, WithALimitLeaveTheRestForLater) {
  Link link = link_with({"slot.period_ms=100", "slot.packets=2"});
  std::vector<double> leaves;
  for (const double t : {10.0, 10.0, 10.0, 10.0, 10.0, 110.0, 110.0, 510.0}) {
    leaves.push_back(slot_ms(link.push(at_ms(t), byte_packet())));
  }
  EXPECT_THAT(leaves, ElementsAre(100.0, 100.0, 200.0, 200.0, 300.0, 300.0, 400.0, 600.0));
}

TEST(LinkSlots, WithALimitAndJitterNeverHoldMoreThanTheirPackets) {
  Link link = link_with({"slot.period_ms=10", "slot.packets=3", "jitter.law=gamma",
                         "jitter.mean_ms=50", "jitter.sd_ms=50"});
  std::map<Instant, int> released;
  for (int i = 0; i < 20'000; ++i) {
    const Instant now = at_ms(3.4 * i);  // 2.94 packets a slot
    const Instant leaves = link.push(now, byte_packet());
    EXPECT_GE(leaves, now);
    ++released[leaves];
    drop_ready(link, now);
  }
  for (const auto& [when, packets] : released) {
    EXPECT_LE(packets, 3);
    EXPECT_EQ((when - kStart) % std::chrono::milliseconds{10}, Duration{0});
  }
}

TEST(LinkSlots, ThatBeginLateAreTheSameForAllTraffic) {
  const std::vector<std::string> late{"slot.period_ms=100", "slot.jitter_ms=80"};
  Link dense = link_with(late), sparse = link_with(late);
  std::set<Instant> slots_of_dense;
  double sum_ms = 0.0;
  for (int i = 0; i < 100'000; ++i) slots_of_dense.insert(dense.push(at_ms(i), byte_packet()));
  for (int i = 0; i < 999; ++i) {
    const Instant slot = sparse.push(at_ms(100.0 * i + 50.0 * (i % 2)), byte_packet());
    EXPECT_TRUE(slots_of_dense.contains(slot));
  }
  for (const Instant slot : slots_of_dense) {
    const double late_ms = std::fmod(slot_ms(slot), 100.0);
    EXPECT_LT(late_ms, 80.0);
    sum_ms += late_ms;
  }
  const auto n = static_cast<double>(slots_of_dense.size());
  EXPECT_NEAR(n, 1000.0, 1.0);
  EXPECT_NEAR(sum_ms / n, 40.0, kSlotSigmas * 80.0 / std::sqrt(12.0 * n));
}

}  // namespace
}  // namespace tether
