#include "common/bus/message_io.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <string>
#include <tether/channel_setting_result_t.hpp>
#include <tether/channel_setting_t.hpp>
#include <tether/clock_t.hpp>
#include <tether/controller_report_t.hpp>
#include <tether/counters_t.hpp>
#include <tether/ground_truth_t.hpp>
#include <tether/link_report_t.hpp>
#include <tether/plan_in_force_t.hpp>
#include <tether/plan_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/twist_t.hpp>
#include <vector>

#include "common/bus/counter_reporter.hpp"
#include "common/bus/in_process_bus.hpp"
#include "common/loop/virtual_loop.hpp"

namespace tether {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using Bytes = std::vector<std::uint8_t>;

template <class LcmType>
Bytes encode(const LcmType& message) {
  Bytes bytes(static_cast<std::size_t>(message.getEncodedSize()));
  EXPECT_EQ(message.encode(bytes.data(), 0, static_cast<int>(bytes.size())),
            static_cast<int>(bytes.size()));
  return bytes;
}

template <class LcmType>
LcmType sample() {
  // Every byte of these fixed-size types is then different from zero and from its neighbours.
  LcmType message{};
  Bytes bytes = encode(message);
  for (std::size_t i = 8; i < bytes.size(); ++i) bytes[i] = static_cast<std::uint8_t>(i);
  if (!decode(bytes, message)) ADD_FAILURE() << "cannot make a sample";
  return message;
}

template <>
link_report_t sample() {
  link_report_t message{};
  message.utime = 1;
  message.link = "uplink";
  message.delay_ms_max = 2.5;
  return message;
}

template <>
counters_t sample() {
  counters_t message{};
  message.seq = 7;
  message.node = "sim";
  message.name = {"command.reordered", "", "loop.slips"};
  message.value = {1, INT64_MIN, INT64_MAX};
  message.count = 3;
  return message;
}

template <>
channel_setting_t sample() {
  channel_setting_t message{};
  message.utime = 3;
  message.count = 2;
  message.key = {"downlink.prr", ""};
  message.value = {"0.45", "fixed"};
  return message;
}

template <>
channel_setting_result_t sample() {
  channel_setting_result_t message{};
  message.request_seq = 9;
  message.reason = "because";
  message.count = 1;
  message.key = {"downlink.prr"};
  message.value = {"0.45"};
  return message;
}

template <>
plan_t sample() {
  plan_t message{};
  message.utime = 5;
  message.step_us = 50'000;
  message.count = 3;
  message.v_mps = {1.0F, -0.25F, 3e38F};
  message.omega_radps = {0.5F, 0.0F, -1e-40F};
  return message;
}

template <>
time_join_t sample() {
  time_join_t message{};
  message.node = "sim";
  message.next_ns = 1;
  message.count = 2;
  message.subscription = {"AGV/CMD_VEL", ""};
  return message;
}

template <>
time_welcome_t sample() {
  time_welcome_t message{};
  message.node = "sim";
  message.rank = 3;
  message.count = 2;
  message.subscription = {"AGV/CMD_VEL", ""};
  return message;
}

template <>
time_grant_t sample() {
  time_grant_t message{};
  message.node = "sim";
  message.count = 2;
  message.publisher = {"netem", ""};
  message.channel = {"AGV/CMD_VEL", ""};
  message.number = message.time_ns = message.order = message.size = message.crc32 = {INT64_MIN, 7};
  return message;
}

template <>
time_request_t sample() {
  time_request_t message{};
  message.node = "sim";
  message.error = "because";
  message.count = 2;
  message.channel = {"AGV/CMD_VEL", ""};
  message.number = message.time_ns = message.index = message.size = message.crc32 = {INT64_MIN, 7};
  return message;
}

template <>
time_resend_t sample() {
  time_resend_t message{};
  message.publisher = "sim";
  message.channel = "AGV/POSE";
  return message;
}

template <class LcmType>
struct MessageIo : testing::Test {};

using AllTypes = testing::Types<channel_setting_t, channel_setting_result_t, clock_t,
                                controller_report_t, counters_t, ground_truth_t, link_report_t,
                                plan_in_force_t, plan_t, pose_t, time_grant_t, time_join_t,
                                time_request_t, time_resend_t, time_welcome_t, twist_t>;
TYPED_TEST_SUITE(MessageIo, AllTypes);

TYPED_TEST(MessageIo, AMessageSurvivesEncodingAndDecoding) {
  const Bytes bytes = encode(sample<TypeParam>());
  TypeParam message{};
  ASSERT_TRUE(decode(bytes, message));
  EXPECT_EQ(encode(message), bytes);
}

TYPED_TEST(MessageIo, EveryTruncationIsRefused) {
  const Bytes bytes = encode(sample<TypeParam>());
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    // A copy of its own, so that AddressSanitizer sees every byte read beyond it.
    const Bytes truncated(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size));
    TypeParam message{};
    EXPECT_FALSE(decode(truncated, message)) << size << " bytes";
  }
}

TYPED_TEST(MessageIo, AByteTooManyIsRefused) {
  Bytes bytes = encode(sample<TypeParam>());
  bytes.push_back(0);
  TypeParam message{};
  EXPECT_FALSE(decode(bytes, message));
}

TYPED_TEST(MessageIo, RandomBytesAreRefused) {
  std::mt19937 random(1);
  for (int i = 0; i < 2000; ++i) {
    Bytes bytes(random() % 300);
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
    TypeParam message{};
    EXPECT_FALSE(decode(bytes, message));
  }
}

TYPED_TEST(MessageIo, ADamagedMessageOfTheRightTypeIsDecodedWholeOrRefused) {
  const Bytes bytes = encode(sample<TypeParam>());
  std::mt19937 random(2);
  for (int i = 0; i < 5000; ++i) {
    Bytes damaged = bytes;
    for (std::size_t n = random() % 8 + 1; n > 0; --n) {
      damaged[8 + random() % (damaged.size() - 8)] = static_cast<std::uint8_t>(random());
    }
    TypeParam message{};
    if (decode(damaged, message)) {
      EXPECT_EQ(message.getEncodedSize(), static_cast<int>(damaged.size()));
    }
  }
}

TYPED_TEST(MessageIo, AnotherTypeIsRefused) {
  const Bytes bytes = encode(sample<TypeParam>());
  int accepted_by = 0;
  const auto offer = [&](auto message) { accepted_by += decode(bytes, message) ? 1 : 0; };
  offer(channel_setting_t{});
  offer(channel_setting_result_t{});
  offer(clock_t{});
  offer(controller_report_t{});
  offer(counters_t{});
  offer(ground_truth_t{});
  offer(link_report_t{});
  offer(plan_in_force_t{});
  offer(plan_t{});
  offer(pose_t{});
  offer(time_grant_t{});
  offer(time_join_t{});
  offer(time_request_t{});
  offer(time_resend_t{});
  offer(time_welcome_t{});
  offer(twist_t{});
  EXPECT_EQ(accepted_by, 1);
}

void put_int32(Bytes& bytes, std::size_t offset, std::int32_t value) {
  for (std::size_t i = 0; i < 4; ++i) {
    bytes[offset + i] =
        static_cast<std::uint8_t>(static_cast<std::uint32_t>(value) >> (24 - 8 * i));
  }
}

constexpr std::int32_t kImpossibleLengths[] = {
    0, -1, -2, -4, -8, -100, 1 << 20, 1 << 30, INT32_MAX - 1, INT32_MAX, INT32_MIN, INT32_MIN + 1};

// Fields: fingerprint 8, utime 8, seq 8, then the string's length.
TEST(MessageIoLengths, AnImpossibleStringLengthIsRefused) {
  for (const std::int32_t length : kImpossibleLengths) {
    Bytes report = encode(sample<link_report_t>());
    put_int32(report, 24, length);
    link_report_t link_report{};
    EXPECT_FALSE(decode(report, link_report)) << length;

    Bytes counters_bytes = encode(sample<counters_t>());
    put_int32(counters_bytes, 24, length);
    counters_t counters{};
    EXPECT_FALSE(decode(counters_bytes, counters)) << length;
  }
}

// "sim" and its zero follow the length at 24: the count is at 32, the first name's length at 36.
TEST(MessageIoLengths, AnImpossibleArrayCountIsRefusedBeforeMemoryIsTaken) {
  for (const std::int32_t count : kImpossibleLengths) {
    Bytes bytes = encode(sample<counters_t>());
    put_int32(bytes, 32, count);
    counters_t counters{};
    EXPECT_FALSE(decode(bytes, counters)) << count;
    EXPECT_LT(counters.name.capacity(), 100U) << count;
  }
}

TEST(MessageIoLengths, AnImpossibleStringLengthInsideAnArrayIsRefused) {
  for (const std::int32_t length : kImpossibleLengths) {
    Bytes bytes = encode(sample<counters_t>());
    put_int32(bytes, 36, length);
    counters_t counters{};
    EXPECT_FALSE(decode(bytes, counters)) << length;
  }
}

// Settings: the count is at 24, the first key's length at 28; of a result, the reason's length at
// 41, "because" and its zero behind it, then the count.
TEST(MessageIoLengths, ImpossibleLengthsOfSettingsAreRefused) {
  for (const std::int32_t length : kImpossibleLengths) {
    for (const std::size_t offset : {24U, 28U}) {
      Bytes bytes = encode(sample<channel_setting_t>());
      put_int32(bytes, offset, length);
      channel_setting_t setting{};
      EXPECT_FALSE(decode(bytes, setting)) << length << " at " << offset;
      EXPECT_LT(setting.key.capacity(), 100U);
    }
    for (const std::size_t offset : {41U, 53U, 57U}) {
      Bytes bytes = encode(sample<channel_setting_result_t>());
      put_int32(bytes, offset, length);
      channel_setting_result_t result{};
      EXPECT_FALSE(decode(bytes, result)) << length << " at " << offset;
    }
  }
}

// Of a plan, the count is at 68; two arrays of that length follow.
TEST(MessageIoLengths, AnImpossibleNumberOfTwistsIsRefusedBeforeMemoryIsTaken) {
  for (const std::int32_t count : kImpossibleLengths) {
    Bytes bytes = encode(sample<plan_t>());
    put_int32(bytes, 84, count);
    plan_t plan{};
    EXPECT_FALSE(decode(bytes, plan)) << count;
    EXPECT_LT(plan.v_mps.capacity(), 100U) << count;
  }
}

TEST(MessageIoLengths, TheLongestPlanFits) {
  plan_t longest{};
  longest.count = plan_t::MAX_COUNT;
  longest.v_mps.resize(plan_t::MAX_COUNT);
  longest.omega_radps.resize(plan_t::MAX_COUNT);
  plan_t plan{};
  EXPECT_TRUE(decode(encode(longest), plan));
}

TEST(MessageIoLengths, NoCountersAreACountOfZero) {
  counters_t none{};
  none.node = "sim";
  counters_t counters{};
  EXPECT_TRUE(decode(encode(none), counters));
  EXPECT_EQ(counters.count, 0);
}

TEST(MessageIoLengths, MoreBytesThanAnyMessageNeedsAreRefused) {
  counters_t big{};
  big.node = std::string(1 << 16, 'x');
  counters_t counters{};
  EXPECT_FALSE(decode(encode(big), counters));
  big.node.resize((1 << 16) - 100);
  EXPECT_TRUE(decode(encode(big), counters));
}

TEST(MessageIoValues, NotANumberAndInfinityPassForTheReceiverToJudge) {
  pose_t sent{};
  sent.x_m = std::numeric_limits<double>::quiet_NaN();
  sent.y_m = -std::numeric_limits<double>::infinity();
  pose_t received{};
  ASSERT_TRUE(decode(encode(sent), received));
  EXPECT_TRUE(std::isnan(received.x_m));
  EXPECT_EQ(received.y_m, sent.y_m);
}

struct SubscribeTest : testing::Test {
  VirtualLoop loop;
  InProcessBus bus{loop};
};

TEST_F(SubscribeTest, WhatCannotBeDecodedIsCountedAndGoesNoFurther) {
  std::int64_t undecodable = 0;
  std::vector<std::int64_t> received;
  subscribe<pose_t>(bus, "AGV/POSE", 1, undecodable,
                    [&](const pose_t& m) { received.push_back(m.seq); });
  pose_t pose{};
  pose.seq = 42;
  publish(bus, "AGV/POSE", twist_t{});
  publish(bus, "AGV/POSE", pose);
  bus.publish("AGV/POSE", {});
  loop.run_until(kStart);
  EXPECT_THAT(received, ElementsAre(42));
  EXPECT_EQ(undecodable, 2);
}

TEST_F(SubscribeTest, ACounterReporterPublishesAllCountersEveryPeriodAndAtTheEnd) {
  struct Report {
    std::int64_t utime, seq;
    std::vector<std::string> names;
    std::vector<std::int64_t> values;
  };
  std::vector<Report> reports;
  std::int64_t undecodable = 0;
  subscribe<counters_t>(bus, "NET/COUNTERS", 1, undecodable, [&](const counters_t& m) {
    EXPECT_EQ(m.node, "netem");
    reports.push_back({m.utime, m.seq, m.name, m.value});
  });
  std::int64_t lost = 0;
  CounterReporter reporter(loop, bus, "netem", "NET/COUNTERS", 500ms,
                           [&](CounterList& list) { list.emplace_back("lost", ++lost); });
  loop.run_until(kStart + 1s);
  reporter.publish_now();
  loop.run_until(kStart + 1s);
  ASSERT_EQ(reports.size(), 3U);
  EXPECT_EQ(reports[0].utime, 500'000);
  EXPECT_EQ(reports[1].utime, 1'000'000);
  EXPECT_EQ(reports[2].seq, 2);
  EXPECT_THAT(reports[2].names, ElementsAre("lost", "loop.slips"));
  EXPECT_THAT(reports[2].values, ElementsAre(3, 0));
  EXPECT_EQ(undecodable, 0);
}

}  // namespace
}  // namespace tether
