#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "common/ros2/cdr.hpp"
#include "doors/ros2/cdr_reader.hpp"
#include "doors/ros2/command_gate.hpp"
#include "doors/ros2/vehicle_topics.hpp"

namespace tether {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::uint64_t kOne = 1, kOther = 2;

std::string stamped(const std::string& frame, std::int32_t seconds, const Twist& twist) {
  CdrWriter out;
  out.put(seconds);
  out.put(std::uint32_t{500'000'000});
  out.put(std::string_view(frame));
  for (const double x : {twist.v_mps, 0.0, 0.0, 0.0, 0.0, twist.omega_radps}) out.put(x);
  return out.bytes;
}

RosCommand command(double v_mps) { return {.header = {}, .twist = {v_mps, 0.0}}; }

std::int64_t counted(const CommandGate& gate, const std::string& name) {
  CounterList all;
  gate.list(all);
  for (const auto& [key, value] : all) {
    if (key == "ros2." + name) return value;
  }
  return -1;
}

TEST(CdrReader, ReadsTheTwistThatTheExportWrites) {
  const auto read = read_twist(twist_cdr({0.5, -0.25}));
  ASSERT_TRUE(read);
  EXPECT_EQ(read->twist.v_mps, 0.5);
  EXPECT_EQ(read->twist.omega_radps, -0.25);
  EXPECT_EQ(read->other, 0.0);
  EXPECT_FALSE(read->header);
}

TEST(CdrReader, ReadsStampAndFrameOfAnyLength) {
  for (const std::string frame : {"", "b", "base_link", "agv12/base_link"}) {
    const auto read = read_twist_stamped(stamped(frame, -3, {1.5, 0.5}));
    ASSERT_TRUE(read) << frame;
    EXPECT_EQ(read->header->stamp_ns, -3 * kSecond_ns + kSecond_ns / 2);
    EXPECT_EQ(read->header->frame_id, frame);
    EXPECT_EQ(read->twist.v_mps, 1.5);
    EXPECT_EQ(read->twist.omega_radps, 0.5);
  }
}

TEST(CdrReader, ReadsBigEndian) {
  std::string bytes = twist_cdr({0.5, 0.0});
  bytes[1] = 0;
  for (std::size_t i = 4; i < bytes.size(); i += 8) {
    std::reverse(bytes.begin() + static_cast<std::ptrdiff_t>(i),
                 bytes.begin() + static_cast<std::ptrdiff_t>(i) + 8);
  }
  ASSERT_TRUE(read_twist(bytes));
  EXPECT_EQ(read_twist(bytes)->twist.v_mps, 0.5);
}

TEST(CdrReader, RefusesEachMessageThatIsCut) {
  const std::string whole = stamped("base_link", 1, {1.0, 0.0});
  for (std::size_t size = 0; size < whole.size(); ++size) {
    EXPECT_FALSE(read_twist_stamped(std::string_view(whole).substr(0, size))) << size;
  }
  EXPECT_TRUE(read_twist_stamped(whole));
}

TEST(CdrReader, RefusesImpossibleLengthsAndOtherEncapsulations) {
  std::string text = stamped("base_link", 1, {1.0, 0.0});
  text[12] = text[13] = text[14] = text[15] = '\xff';  // length of frame_id
  EXPECT_FALSE(read_twist_stamped(text));
  std::string xcdr2 = twist_cdr({1.0, 0.0});
  xcdr2[1] = 7;
  EXPECT_FALSE(read_twist(xcdr2));
  EXPECT_FALSE(read_twist(twist_cdr({1.0, 0.0}) + std::string(8, '\0')));
}

TEST(CommandGate, LetsOnePublisherDrive) {
  CommandGate gate({});
  EXPECT_EQ(gate.take(kStart + 1s, kOne, command(0.5))->v_mps, 0.5);
  EXPECT_EQ(counted(gate, "accepted"), 1);
}

TEST(CommandGate, RefusesAllOfTwoPublishersUntilOneIsSilent) {
  CommandGate gate({});
  Instant now = kStart;
  int accepted = 0;
  for (int i = 0; i < 40; ++i, now += 50ms) {
    accepted += gate.take(now, i % 2 == 0 ? kOne : kOther, command(0.5)) ? 1 : 0;
  }
  EXPECT_TRUE(gate.several(now));
  EXPECT_LE(accepted, 5);
  EXPECT_EQ(counted(gate, "several"), 40 - accepted);
  now += SenderWatch::kMemory + 100ms;
  EXPECT_TRUE(gate.take(now, kOther, command(0.5)));
}

TEST(CommandGate, RefusesWhatNoVehicleShallFollow) {
  CommandGate gate({});
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInf = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(gate.take(kStart, kOne, command(kNan)));
  EXPECT_FALSE(gate.take(kStart, kOne, command(-kInf)));
  RosCommand rolls = command(0.5);
  rolls.other = kNan;
  EXPECT_FALSE(gate.take(kStart, kOne, rolls));
  EXPECT_EQ(counted(gate, "non_finite"), 3);
  rolls.other = 0.1;
  EXPECT_FALSE(gate.take(kStart, kOne, rolls));
  EXPECT_EQ(counted(gate, "sideways"), 1);
  EXPECT_FALSE(gate.take(kStart, kOne, std::nullopt));
  EXPECT_EQ(counted(gate, "undecodable"), 1);
  EXPECT_EQ(counted(gate, "accepted"), 0);
}

TEST(CommandGate, RefusesStampsThatAreOldOrAheadAndOtherFrames) {
  CommandGate gate({.frame = "base_link", .max_age = 500ms, .shift_ns = 7 * kSecond_ns});
  const auto taken = [&](double stamp_s, const std::string& frame) {
    RosCommand stamped = command(0.5);
    stamped.header = {.stamp_ns = std::llround(stamp_s * 1e9) + 7 * kSecond_ns, .frame_id = frame};
    return gate.take(kStart + 10s, kOne, stamped).has_value();
  };
  EXPECT_TRUE(taken(10.0, "base_link"));
  EXPECT_TRUE(taken(9.5, ""));
  EXPECT_FALSE(taken(9.499, "base_link"));
  EXPECT_EQ(counted(gate, "old"), 1);
  EXPECT_FALSE(taken(10.501, "base_link"));
  EXPECT_EQ(counted(gate, "from_future"), 1);
  EXPECT_FALSE(taken(10.0, "agv1/base_link"));
  EXPECT_EQ(counted(gate, "wrong_frame"), 1);
}

std::vector<std::string> topics(const std::vector<RosMessage>& messages) {
  std::vector<std::string> all;
  for (const RosMessage& m : messages) all.push_back(m.topic + " " + std::string(m.type));
  return all;
}

TEST(VehicleTopics, AreInTheNamespaceOfTheVehicle) {
  EXPECT_EQ(ros2_namespace("AGV", true), "");
  EXPECT_EQ(ros2_namespace("AGV7", false), "agv7");
  EXPECT_EQ(ros2_namespace("7-up", false), "_7_up");
  VehicleTopics topics_of_7("agv7", 0);
  EXPECT_EQ(topics_of_7.topic("cmd_vel"), "/agv7/cmd_vel");
  EXPECT_EQ(topics_of_7.base_frame(), "agv7/base_link");
  EXPECT_THAT(
      topics(topics_of_7.on_pose(kStart, {})),
      ElementsAre("/agv7/pose geometry_msgs/msg/PoseStamped", "/agv7/tf tf2_msgs/msg/TFMessage"));
}

TEST(VehicleTopics, WithoutOdometryThePoseIsInOdom) {
  VehicleTopics door("", 0);
  const Pose2 pose{1.0, 2.0, 0.5};
  EXPECT_EQ(door.on_pose(kStart + 1s, pose)[1].cdr,
            tf_cdr({{{kSecond_ns, "map"}, "odom", {}}, {{kSecond_ns, "odom"}, "base_link", pose}}));
}

TEST(VehicleTopics, MapToOdomIsWhatOdometryOfThePosesInstantIsOff) {
  VehicleTopics door("", 0);
  const Pose2 there{2.0, 0.0, 0.0};
  door.on_odometry({kStart + 1s, there, {}, {}});
  door.on_odometry({kStart + 2s, {9.0, 9.0, 1.0}, {}, {}});
  // The vehicle was at (1, 1), turned by a quarter: odom's origin is 2 m behind it.
  const double quarter = std::numbers::pi / 2.0;
  const Pose2 odom{1.0 - 2.0 * std::cos(quarter), 1.0 - 2.0 * std::sin(quarter), quarter};
  EXPECT_EQ(door.on_pose(kStart + 1s, {1.0, 1.0, quarter})[1].cdr,
            tf_cdr({{{kSecond_ns, "map"}, "odom", odom}}));
}

TEST(VehicleTopics, TfStaticComesOnceForEachMount) {
  VehicleTopics door("", 0);
  Scan scan;
  scan.stamp = kStart;
  scan.mount = {0.3, 0.0, 0.0};
  scan.range_m = {1.0F, 0.0F};
  EXPECT_THAT(topics(door.on_scan(scan)),
              ElementsAre("/tf_static tf2_msgs/msg/TFMessage", "/scan sensor_msgs/msg/LaserScan"));
  EXPECT_THAT(topics(door.on_scan(scan)), ElementsAre("/scan sensor_msgs/msg/LaserScan"));
  scan.mount.x_m = 0.4;
  EXPECT_EQ(door.on_scan(scan).size(), 2U);
}

}  // namespace
}  // namespace tether
