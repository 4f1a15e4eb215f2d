#include "tools/messages/message_printer.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <limits>
#include <set>
#include <string>
#include <tether/counters_t.hpp>
#include <tether/plan_t.hpp>
#include <tether/pose_t.hpp>
#include <vector>

namespace tether {
namespace {

template <class LcmType>
std::vector<std::uint8_t> encoded(const LcmType& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

pose_t some_pose() {
  pose_t pose{};
  pose.utime = 50'000;
  pose.seq = 1;
  pose.x_m = 0.1;
  pose.y_m = -2.0;
  pose.yaw_rad = std::numeric_limits<double>::quiet_NaN();
  pose.plan_session = 3;
  pose.plan_id = -1;
  return pose;
}

counters_t some_counters() {
  counters_t counters{};
  counters.node = "sim";
  counters.count = 2;
  counters.name = {"a,b", "\x1b[2J"};
  counters.value = {7, -8};
  return counters;
}

plan_t some_plan() {
  plan_t plan{};
  plan.session = 3;
  plan.based_on = plan.based_on_last = plan_t::ANY;
  plan.step_us = 50'000;
  plan.count = 2;
  plan.v_mps = {0.1F, 2.0F};
  plan.omega_radps = {-0.3F, std::numeric_limits<float>::infinity()};
  return plan;
}

TEST(MessageTypes, HaveDifferentFingerprints) {
  std::set<std::int64_t> fingerprints;
  for (const MessageType& type : message_types()) fingerprints.insert(type.fingerprint);
  EXPECT_EQ(fingerprints.size(), message_types().size());
}

TEST(MessageTypes, AllCarryTimeAndNumber) {
  for (const MessageType& type : message_types()) {
    EXPECT_EQ(type.field_names.at(0), "utime") << type.name;
    EXPECT_EQ(type.field_names.at(1), "seq") << type.name;
  }
}

TEST(InspectMessage, DecodesAPose) {
  const MessageContent content = inspect_message(encoded(some_pose()));
  ASSERT_TRUE(content.decoded());
  EXPECT_EQ(type_label(content), "pose_t");
  EXPECT_EQ(content.integer("seq"), 1);
  EXPECT_EQ(content.integer("x_m"), std::nullopt);
  EXPECT_EQ(content.integer("nonsense"), std::nullopt);
  EXPECT_EQ(format_message("AGV/POSE", content),
            "AGV/POSE pose_t utime=50000 seq=1 run=0 x_m=0.1 y_m=-2 yaw_rad=nan "
            "plan_session=3 plan_id=-1");
}

TEST(InspectMessage, RecognisesNothingInTooFewBytes) {
  const std::vector<std::uint8_t> bytes(7, 0);
  EXPECT_EQ(format_message("X", inspect_message({})), "X - (unknown type, 0 bytes)");
  EXPECT_EQ(format_message("X", inspect_message(bytes)), "X - (unknown type, 7 bytes)");
}

TEST(InspectMessage, ShowsFingerprintAndSizeOfUnknownTypes) {
  const std::vector<std::uint8_t> bytes = {0xfe, 0xdc, 0xba, 0x98, 0x76, 0x54, 0x32, 0x10, 1, 2};
  EXPECT_EQ(format_message("X", inspect_message(bytes)),
            "X 0xfedcba9876543210 (unknown type, 10 bytes)");
}

TEST(InspectMessage, EveryTruncationIsUndecodableAndHarmless) {
  for (const auto& whole : {encoded(some_pose()), encoded(some_counters()), encoded(some_plan())}) {
    for (std::size_t size = 0; size < whole.size(); ++size) {
      const MessageContent content = inspect_message(std::span(whole).first(size));
      EXPECT_FALSE(content.decoded()) << size;
      EXPECT_EQ(content.type != nullptr, size >= 8) << size;
    }
  }
}

TEST(InspectMessage, TrailingBytesMakeAMessageUndecodable) {
  std::vector<std::uint8_t> bytes = encoded(some_pose());
  bytes.push_back(0);
  EXPECT_EQ(format_message("X", inspect_message(bytes)), "X pose_t (undecodable, 73 bytes)");
}

TEST(InspectMessage, SurvivesEveryCorruptArrayLength) {
  std::vector<std::uint8_t> bytes = encoded(some_counters());
  const std::size_t count_offset = 8 + 8 + 8 + 4 + 4;  // fingerprint, utime, seq, "sim"
  for (const std::uint8_t high : {0x00, 0x7f, 0x80, 0xff}) {
    bytes[count_offset] = high;
    bytes[count_offset + 3] = 0xff;
    EXPECT_FALSE(inspect_message(bytes).decoded()) << int{high};
  }
}

TEST(FormatMessage, KeepsControlCharactersFromTheTerminal) {
  EXPECT_EQ(
      format_message("SIM\n", inspect_message(encoded(some_counters()))),
      "SIM\\x0a counters_t utime=0 seq=0 node=sim count=2 name=[a,b, \\x1b[2J] value=[7, -8]");
}

TEST(FormatMessage, ShowsAPlansTwistsAsShortAsFloatsCanBe) {
  EXPECT_EQ(format_message("CTRL/PLAN", inspect_message(encoded(some_plan()))),
            "CTRL/PLAN plan_t utime=0 seq=0 run=0 session=3 id=0 based_on=-2 based_on_last=-2 "
            "pose_utime=0 start_utime=0 settled_utime=0 step_us=50000 count=2 v_mps=[0.1, 2] "
            "omega_radps=[-0.3, inf]");
}

TEST(Csv, QuotesWhatNeedsQuotes) {
  const MessageContent content = inspect_message(encoded(some_counters()));
  EXPECT_EQ(csv_names(*content.type), "utime,seq,node,count,name,value");
  EXPECT_EQ(csv_values(content.values), "0,0,sim,2,\"a,b;\x1b[2J\",7;-8");
  EXPECT_EQ(csv_values({std::string("say \"x\""), true, false}), "\"say \"\"x\"\"\",1,0");
}

TEST(Csv, DoublesSurviveTheRoundTrip) {
  for (const double x :
       {0.1, 1.0 / 3.0, -1e-300, 1.7976931348623157e308, 5e-324, 17.045823064878373}) {
    EXPECT_EQ(std::strtod(csv_values({x}).c_str(), nullptr), x) << x;
  }
}

}  // namespace
}  // namespace tether
