#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/scenario/scenario.hpp"
#include "netem/medium/medium_settings.hpp"
#include "netem/medium/shared_medium.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

MediumSettings medium_with(std::vector<std::string> overrides, const std::string& background = "") {
  return parse_scenario("[medium]\nmodel = \"dcf\"\n" + background, "test.toml", overrides)
      .get<MediumSettings>();
}

const std::string kSaturated = "[[medium.background]]\nkind = \"saturated\"\nstations = 3\n";

TEST(OfferedLoad, OfWhatIsSentWhenItChangesIsBetweenItsAgeLimitAndAllOfIt) {
  const OfferedLoad always = offered_load(medium_with({"sensor.rate_hz=20"}));
  EXPECT_EQ(always.least, always.most);
  const OfferedLoad changed = offered_load(
      medium_with({"sensor.rate_hz=20", "sensor.send=changed", "sensor.send_max_age_s=0.5"}));
  EXPECT_DOUBLE_EQ(changed.most, always.most);
  EXPECT_NEAR(changed.least, always.least / 10, 1e-12);  // a command for each pose
  const OfferedLoad commands = offered_load(medium_with(
      {"sensor.rate_hz=20", "controller.send=changed", "controller.send_max_age_s=0.5"}));
  EXPECT_DOUBLE_EQ(commands.most, always.most);
  EXPECT_GT(commands.least, changed.least);
  EXPECT_LT(commands.least, always.least);
}

TEST(OfferedLoad, IsReportedWhereOnlyTheSumOfTheTrafficIsTooMuch) {
  const std::vector<std::string> few{
      "sensor.send=changed", "fleet.count=40",           "fleet.columns=32",  "fleet.offset_x_m=45",
      "fleet.offset_y_m=45", "world.half_extent_m=9999", "medium.rate_Mbps=1"};
  EXPECT_THAT(medium_warning(medium_with(few)), StartsWith("[medium] is asked for up to "));
  EXPECT_THAT(medium_warning(medium_with(few)),
              HasSubstr("if all poses and commands were sent; with send = \"changed\" it is"));
  std::vector<std::string> many = few;
  many.emplace_back("sensor.send_max_age_s=0.05");
  EXPECT_THAT(medium_warning(medium_with(many)), HasSubstr("it cannot carry all"));
}

// 541 beams of two bytes: one part of 1400 bytes at most, or two of 700.
TEST(OfferedLoad, HasTheScansThatGoToTheEdgeInsteadOfPoses) {
  const std::vector<std::string> edge{"localiser.place=edge", "lidar.model=custom",
                                      "sensor.odometry_rate_hz=50", "lidar.rate_hz=15"};
  const MediumSettings whole = medium_with(edge);
  EXPECT_FALSE(whole.poses_go_up);
  ASSERT_EQ(whole.more_up.size(), 2U);
  EXPECT_EQ(whole.more_up[0].rate_hz, 50.0);
  EXPECT_EQ(whole.more_up[1].rate_hz, 15.0);
  EXPECT_EQ(whole.down.rate_hz, 15.0) << "a command for each pose, a pose for each scan";
  EXPECT_GT(whole.more_up[1].bytes, 2 * 541);
  std::vector<std::string> in_parts = edge;
  in_parts.emplace_back("localiser.part_bytes=700");
  EXPECT_EQ(medium_with(in_parts).more_up.size(), 3U);
  MediumSettings blind = whole;
  blind.more_up.clear();
  EXPECT_GT(offered_load(whole).least, offered_load(blind).least + 15 * 8e-6 * 1082 / 54);
  std::vector<std::string> on_board = edge;
  on_board[0] = "localiser.place=vehicle";
  EXPECT_TRUE(medium_with(on_board).poses_go_up);
  EXPECT_EQ(medium_with(on_board).up.rate_hz, 15.0);
}

TEST(OfferedLoad, OfSaturatedStationsIsAllAndTheAccessPointsShareIsReported) {
  EXPECT_THAT(medium_warning(medium_with({}, kSaturated)),
              HasSubstr("has 3 saturated stations, and no time left"));
  EXPECT_THAT(medium_warning(medium_with({}, kSaturated)), HasSubstr("and is asked for 20"));
  const std::vector<std::string> voice{"medium.model=edca", "medium.category=VO"};
  EXPECT_FALSE(offered_load(medium_with(voice, kSaturated)).most_down_hz)
      << "other windows than theirs";
  EXPECT_THAT(refusal_of([] { medium_with({"medium.model=scheduled"}, kSaturated); }),
              HasSubstr("kind = \"saturated\" needs medium.model = \"dcf\" or \"edca\""));
}

TEST(MediumWarning, NamesAFleetThatSendsInTheSameInstantOnWifi) {
  const std::vector<std::string> six{"fleet.count=6", "fleet.offset_x_m=45",
                                     "world.half_extent_m=9999", "fleet.ticks=together"};
  EXPECT_THAT(medium_warning(medium_with(six)),
              StartsWith("fleet.ticks = \"together\": 6 vehicles send in the same instant"));
  std::vector<std::string> spread = six;
  spread.back() = "fleet.ticks=spread";
  EXPECT_EQ(medium_warning(medium_with(spread)), "");
  std::vector<std::string> cell = six;
  cell.emplace_back("medium.model=scheduled");
  EXPECT_EQ(medium_warning(medium_with(cell)), "") << "a base station grants";
}

// Offered more than it can send, among three that are saturated: it sends as many frames as said,
// less what backoff and collisions take, of four stations about a quarter.
TEST(OfferedLoad, OfAnAccessPointAmongSaturatedStationsIsWhatItSendsThenButForBackoff) {
  MediumSettings settings = medium_with({}, kSaturated);
  settings.down = {2000.0, 80};
  std::int64_t delivered = 0;
  const auto medium = SharedMedium::make(
      settings, 1, [&](const PacketFateOnAir& fate) { delivered += fate.delivered ? 1 : 0; });
  medium->add_vehicle("AGV");
  constexpr std::int64_t kPackets = 20'000;
  for (std::int64_t i = 0; i < kPackets; ++i) {
    const Instant at = kStart + i * std::chrono::microseconds{500};
    medium->advance(at);
    medium->send(at, 0, Way::down, static_cast<std::uint64_t>(i), 80);
  }
  const double sent_hz = static_cast<double>(delivered) / (kPackets * 500e-6);
  const double most_hz = offered_load(settings).most_down_hz.value();
  EXPECT_LT(sent_hz, most_hz);
  EXPECT_GT(sent_hz, 0.65 * most_hz);
}

}  // namespace
}  // namespace tether
