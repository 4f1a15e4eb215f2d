#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/base/errors.hpp"
#include "common/scenario/scenario.hpp"
#include "netem/medium/shared_medium.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;
using ::testing::Not;

Scenario with(std::vector<std::string> overrides) {
  return parse_scenario("[medium]\nmodel = \"scheduled\"\n", "test.toml", overrides);
}

std::string refusal(const std::vector<std::string>& overrides) {
  return refusal_of([&] { with(overrides); });
}

TEST(ServingKeys, AreRefusedWhereTheyDoNothingOrHarm) {
  EXPECT_EQ(refusal({"medium.serve=oldest_first", "medium.keep=newest"}), "accepted");
  EXPECT_THAT(refusal({"medium.model=dcf", "medium.serve=oldest_first"}),
              HasSubstr("medium.serve has no effect: medium.model is that of Wi-Fi"));
  EXPECT_THAT(refusal({"medium.serve=newest_first"}),
              HasSubstr("must be \"round_robin\" or \"oldest_first\" or \"most_valuable\""));
  EXPECT_THAT(refusal({"medium.keep=newest", "sensor.odometry_rate_hz=50"}),
              HasSubstr("test.toml: medium.keep = \"newest\" needs vehicles that send nothing but "
                        "poses, for a message replaces another one, whatever it says: "
                        "sensor.odometry_rate_hz must be 0"));
}

TEST(ServingKeys, ByValueNeedVehiclesThatSendNothingButPoses) {
  EXPECT_EQ(refusal({"medium.serve=most_valuable"}), "accepted");
  EXPECT_THAT(refusal({"medium.serve=most_valuable", "sensor.odometry_rate_hz=50"}),
              HasSubstr("medium.serve = \"most_valuable\" needs vehicles that send nothing but "
                        "poses, for what else they send has no value that is known"));
}

TEST(ServingKeys, AreInTheResolvedScenarioOnlyWhereTheyAreGiven) {
  EXPECT_THAT(to_toml(with({})), Not(HasSubstr("serve")));
  EXPECT_THAT(to_toml(with({})), Not(HasSubstr("keep")));
  EXPECT_THAT(to_toml(with({"medium.keep=newest"})), HasSubstr("keep = \"newest\""));
}

// A cell that carries a tenth of what it is asked for: all but the newest are given up at once, and
// each message that arrives is young.
TEST(KeepNewest, OfAnOverloadedCellDeliversWhatIsNewAndEndsEachPacketOnce) {
  for (const bool keep_newest : {false, true}) {
    MediumSettings settings{.model = MediumSettings::Model::scheduled, .rate_Mbps = 1.0};
    settings.keep_newest = keep_newest;
    settings.queue = 1000;
    std::map<std::uint64_t, int> ends;
    Duration oldest{0};
    std::int64_t delivered = 0;
    const auto medium = SharedMedium::make(settings, 1, [&](const PacketFateOnAir& fate) {
      ++ends[fate.id];
      if (!fate.delivered) return;
      ++delivered;
      oldest = std::max(oldest,
                        fate.at - (kStart + static_cast<std::int64_t>(fate.id) * milliseconds{10}));
    });
    medium->add_vehicle("AGV");
    for (std::uint64_t i = 0; i < 200; ++i) {
      const Instant now = kStart + static_cast<std::int64_t>(i) * milliseconds{10};
      medium->send(now, 0, Way::up, i, 12'500);  // 100 ms
      medium->advance(now);
    }
    medium->advance(kStart + std::chrono::hours{1});
    EXPECT_EQ(ends.size(), 200U);
    for (const auto& [id, count] : ends) EXPECT_EQ(count, 1) << id;
    if (keep_newest) {
      EXPECT_LT(oldest, milliseconds{250});  // request, the one before, its own time
      EXPECT_NEAR(static_cast<double>(delivered), 20.0, 2.0);
    } else {
      EXPECT_GT(oldest, milliseconds{9000});
    }
  }
}

}  // namespace
}  // namespace tether
