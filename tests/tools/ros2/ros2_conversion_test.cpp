#include "tools/log/ros2_conversion.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <numbers>
#include <string>
#include <string_view>
#include <tether/all_messages.hpp>
#include <vector>

#include "common/ros2/cdr.hpp"
#include "common/ros2/ros2_messages.hpp"

namespace tether {
namespace {

using testing::ElementsAre;
using namespace std::string_view_literals;

template <class LcmType>
MessageContent content_of(const LcmType& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return inspect_message(bytes);
}

template <class LcmType>
std::vector<std::string> topics(const std::set<std::string>& log, std::string_view channel,
                                const LcmType& message) {
  std::vector<RosMessage> made;
  RosConversion(log, 0).convert(channel, content_of(message), made);
  std::vector<std::string> all;
  for (const RosMessage& m : made) all.push_back(m.topic + " " + std::string(m.type));
  return all;
}

/// The double at an offset of the body.
double real_at(const std::string& cdr, std::size_t offset) {
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    bits |= std::uint64_t{static_cast<std::uint8_t>(cdr.at(4 + offset + i))} << (8 * i);
  }
  return std::bit_cast<double>(bits);
}

TEST(Cdr, SaysThatItIsLittleEndianAndAlignsToTheBodyNotToTheBuffer) {
  CdrWriter out;
  out.put(std::int32_t{1});
  out.put("ab"sv);
  out.put(2.0);
  EXPECT_EQ(out.bytes,
            "\x00\x01\x00\x00"  // encapsulation: little-endian CDR
            "\x01\x00\x00\x00"  // body from here: 0
            "\x03\x00\x00\x00"
            "ab\x00"                // 4: text with its NUL
            "\x00\x00\x00\x00\x00"  // 11: to the next multiple of 8
            "\x00\x00\x00\x00\x00\x00\x00\x40"sv);
}

TEST(Cdr, OfAnEmptyTextHasItsNulAndOfAnEmptySequenceNothing) {
  CdrWriter out;
  out.put(""sv);
  out.sequence(0);
  EXPECT_EQ(out.bytes, "\x00\x01\x00\x00\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00"sv);
}

TEST(RosMessages, ATwistIsSixDoubles) {
  const std::string cdr = twist_cdr({1.5, -0.25});
  ASSERT_EQ(cdr.size(), 4U + 48U);
  EXPECT_EQ(real_at(cdr, 0), 1.5);
  EXPECT_EQ(real_at(cdr, 40), -0.25);
}

TEST(RosMessages, TimesBelowZeroHaveNanosecondsThatCountUp) {
  EXPECT_EQ(clock_cdr(-1), "\x00\x01\x00\x00\xff\xff\xff\xff\xff\xc9\x9a\x3b"sv);
  EXPECT_EQ(clock_cdr(2'000'000'003), "\x00\x01\x00\x00\x02\x00\x00\x00\x03\x00\x00\x00"sv);
  EXPECT_EQ(clock_cdr(INT64_MAX).substr(4, 4), "\xff\xff\xff\x7f"sv);
}

TEST(RosMessages, AnOdometrysCovarianceIsWhereRosHasIt) {
  const PlanarCovariance covariance = {1, 2, 3, 4, 5, 6};
  const std::string cdr = odometry_cdr({{0, "odom"}, "base_link", {}}, covariance, {7.0, 8.0});
  // stamp 8, "odom" 4 + 5, to 20: "base_link" 4 + 10, to 40: pose 56; then 36 doubles.
  const auto at = [&](std::size_t i) { return real_at(cdr, 96 + 8 * i); };
  EXPECT_EQ(at(0), 1);
  EXPECT_EQ(at(1), 2);
  EXPECT_EQ(at(6), 2);
  EXPECT_EQ(at(5), 3);
  EXPECT_EQ(at(30), 3);
  EXPECT_EQ(at(7), 4);
  EXPECT_EQ(at(11), 5);
  EXPECT_EQ(at(31), 5);
  EXPECT_EQ(at(35), 6);
  EXPECT_EQ(at(14), 0);
  EXPECT_EQ(at(36), 7.0);
  EXPECT_EQ(at(41), 8.0);
}

TEST(RosSchemas, HoldEachTypeThatTheyNeedOnce) {
  EXPECT_EQ(ros2_schema(kRosClock), "builtin_interfaces/Time clock\n" + std::string(80, '=') +
                                        "\nMSG: builtin_interfaces/Time\n"
                                        "int32 sec\nuint32 nanosec\n");
  const std::string odometry = ros2_schema(kRosOdometry);
  for (const char* needed : {"std_msgs/Header", "builtin_interfaces/Time", "geometry_msgs/Point",
                             "geometry_msgs/Quaternion", "geometry_msgs/Vector3"}) {
    const std::string line = std::string("MSG: ") + needed + "\n";
    const std::size_t at = odometry.find(line);
    ASSERT_NE(at, std::string::npos) << needed;
    EXPECT_EQ(odometry.find(line, at + 1), std::string::npos) << needed;
  }
}

TEST(RosConversion, ChannelsBecomeTopicsThatRosKnows) {
  EXPECT_THAT(topics({}, "SIM/CLOCK", clock_t{}), ElementsAre("/clock rosgraph_msgs/msg/Clock"));
  EXPECT_THAT(topics({}, "AGV/CMD_VEL", twist_t{}),
              ElementsAre("/cmd_vel geometry_msgs/msg/Twist"));
  EXPECT_THAT(topics({}, "CTRL/CMD_VEL", twist_t{}),
              ElementsAre("/ctrl/cmd_vel geometry_msgs/msg/Twist"));
  EXPECT_THAT(topics({}, "CTRL-A B/POSE", pose_t{}),
              ElementsAre("/ctrl_a_b/pose geometry_msgs/msg/PoseStamped"));
  EXPECT_THAT(topics({}, "NET/COUNTERS", counters_t{}), ElementsAre());
}

scan_t small_scan() {
  scan_t scan{};
  scan.utime = 2'000'000;
  scan.mount_x_m = 1.5;
  scan.angle_min_rad = -1.0;
  scan.angle_increment_rad = 0.5;
  scan.range_max_m = 25.0;
  scan.count = 3;
  scan.range_m = {2.5F, 0.0F, 0.125F};
  return scan;
}

TEST(RosConversion, AScanHasItsFrameWithIt) {
  EXPECT_THAT(topics({}, "AGV/SCAN", small_scan()),
              ElementsAre("/scan sensor_msgs/msg/LaserScan", "/tf tf2_msgs/msg/TFMessage"));
  EXPECT_THAT(topics({}, "AGV7/SCAN", small_scan()),
              ElementsAre("/agv7/scan sensor_msgs/msg/LaserScan"));
}

TEST(RosMessages, BeamsThatSawNothingAreInfinite) {
  std::vector<RosMessage> made;
  RosConversion({}, 0).convert("AGV/SCAN", content_of(small_scan()), made);
  const std::string& cdr = made.at(0).cdr;
  // stamp 8, "laser" 4 + 6, to 20: seven floats; 48: three beams, no intensities.
  ASSERT_EQ(cdr.size(), 4U + 20 + 28 + 4 + 12 + 4);
  EXPECT_EQ(cdr.substr(4 + 20 + 4, 4), "\x00\x00\x00\x00"sv);  // angle_max: 0
  EXPECT_EQ(cdr.substr(4 + 48),
            "\x03\x00\x00\x00"
            "\x00\x00\x20\x40"
            "\x00\x00\x80\x7f"
            "\x00\x00\x00\x3e"
            "\x00\x00\x00\x00"sv);
}

TEST(RosConversion, NamesThatRosRefusesBecomeSuchThatItTakes) {
  const std::pair<const char*, std::string> kNames[] = {
      {"7/1X", "/_7/_1x"}, {"//A//", "/a/_"}, {"/", "/_"}, {"\xff\xc3", "/__"}};
  for (const auto& [channel, topic] : kNames) {
    EXPECT_THAT(topics({}, channel, twist_t{}), ElementsAre(topic + " geometry_msgs/msg/Twist"));
  }
}

TEST(RosConversion, TheOdometryNearestToTheWheelsIsOdom) {
  EXPECT_THAT(topics({"AGV/ODOMETRY"}, "AGV/ODOMETRY", odometry_t{}),
              ElementsAre("/odom nav_msgs/msg/Odometry", "/tf tf2_msgs/msg/TFMessage"));
  EXPECT_THAT(topics({"AGV/ODOMETRY", "CAN/ODOMETRY"}, "AGV/ODOMETRY", odometry_t{}),
              ElementsAre("/agv/odometry nav_msgs/msg/Odometry"));
}

TEST(RosConversion, TheBestSourceAloneMovesBaseLink) {
  const std::set<std::string> all = {"SIM/TRUTH", "CAN/ODOMETRY", "AGV/POSE"};
  EXPECT_THAT(topics(all, "SIM/TRUTH", ground_truth_t{}),
              ElementsAre("/ground_truth nav_msgs/msg/Odometry", "/tf tf2_msgs/msg/TFMessage"));
  EXPECT_THAT(topics(all, "AGV/POSE", pose_t{}),
              ElementsAre("/agv/pose geometry_msgs/msg/PoseStamped"));
  EXPECT_THAT(topics({"AGV/POSE"}, "AGV/POSE", pose_t{}),
              ElementsAre("/agv/pose geometry_msgs/msg/PoseStamped", "/tf tf2_msgs/msg/TFMessage"));
}

TEST(RosConversion, APoseKeepsItsTimeOfMeasurementAndTurnsIntoAQuaternion) {
  pose_t pose{};
  pose.utime = 1'500'000;
  pose.x_m = 3.0;
  pose.yaw_rad = std::numbers::pi;
  std::vector<RosMessage> made;
  RosConversion({}, 1'000'000'000).convert("AGV/POSE", content_of(pose), made);
  const std::string& cdr = made.at(0).cdr;
  EXPECT_EQ(cdr.substr(4, 8), "\x02\x00\x00\x00\x00\x65\xcd\x1d"sv);  // 2 s and 500 000 000 ns
  EXPECT_EQ(real_at(cdr, 16), 3.0);
  EXPECT_EQ(real_at(cdr, 16 + 40), 1.0);           // z
  EXPECT_NEAR(real_at(cdr, 16 + 48), 0.0, 1e-16);  // w
}

}  // namespace
}  // namespace tether
