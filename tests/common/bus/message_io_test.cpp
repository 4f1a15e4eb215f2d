#include "common/bus/message_io.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <random>
#include <set>
#include <string>
#include <tether/all_messages.hpp>
#include <tether/every_kind_t.hpp>
#include <type_traits>
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

/// Fills the fields that it visits: numbers that differ, strings of up to two letters (a boolean in
/// C++ is a number too), arrays of two elements.
struct Filler {
  int next = 1;

  template <class Field>
  void operator()(const char* name, Field& field) {
    if constexpr (std::is_array_v<Field>) {
      for (auto& element : field) (*this)(name, element);
    } else if constexpr (std::is_same_v<Field, std::string>) {
      field = std::string(next++ % 3, 'x');
    } else {
      field = static_cast<Field>(next++ * 0x0102030405060708);
    }
  }
  template <class Element, class Count>
  void operator()(const char* name, std::vector<Element>& array, Count& count) {
    count = 2;
    array.resize(2);
    for (Element& element : array) (*this)(name, element);
  }
};

template <class LcmType>
LcmType sample() {
  LcmType message{};
  visit_fields(message, Filler{});
  return message;
}

/// Where the lengths of strings and the counts of arrays stand in an encoded message.
struct LengthOffsets {
  std::size_t at = 8;  // behind the fingerprint; in the end the message's size
  std::map<const void*, std::size_t> numbers;
  std::set<std::size_t> found, counts;

  template <class Field>
  void operator()(const char* name, const Field& field) {
    if constexpr (std::is_array_v<Field>) {
      for (const auto& element : field) (*this)(name, element);
    } else if constexpr (std::is_same_v<Field, std::string>) {
      found.insert(at);
      at += 4 + field.size() + 1;
    } else {
      numbers[&field] = at;
      at += sizeof field;
    }
  }
  template <class Element, class Count>
  void operator()(const char* name, const std::vector<Element>& array, const Count& count) {
    static_assert(sizeof count == 4);
    counts.insert(numbers.at(&count));
    found.insert(numbers.at(&count));
    for (const Element& element : array) (*this)(name, element);
  }
};

/// Memory that a message's arrays have taken.
struct Capacity {
  std::size_t elements = 0;

  void operator()(const char*, const auto&) {}
  void operator()(const char*, const auto& array, auto) { elements += array.capacity(); }
};

void put_int32(Bytes& bytes, std::size_t offset, std::int32_t value) {
  for (std::size_t i = 0; i < 4; ++i) {
    bytes[offset + i] =
        static_cast<std::uint8_t>(static_cast<std::uint32_t>(value) >> (24 - 8 * i));
  }
}

constexpr std::int32_t kImpossibleLengths[] = {
    0, -1, -2, -4, -8, -100, 1 << 20, 1 << 30, INT32_MAX - 1, INT32_MAX, INT32_MIN, INT32_MIN + 1};

template <class LcmType>
struct MessageIo : testing::Test {};

template <class... LcmTypes>
using WithEveryKind = testing::Types<every_kind_t, LcmTypes...>;
using AllTypes = AllMessages<WithEveryKind>;
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

template <class... LcmTypes>
struct Offer {
  static int accepted_by(const Bytes& bytes) {
    return (0 + ... + [&](auto message) { return decode(bytes, message) ? 1 : 0; }(LcmTypes{}));
  }
};

TYPED_TEST(MessageIo, AnotherTypeIsRefused) {
  EXPECT_EQ(AllMessages<Offer>::accepted_by(encode(sample<TypeParam>())),
            (std::is_same_v<TypeParam, every_kind_t> ? 0 : 1));
}

TYPED_TEST(MessageIo, EveryImpossibleLengthIsRefusedBeforeMemoryIsTaken) {
  auto whole = sample<TypeParam>();
  LengthOffsets lengths;
  visit_fields(whole, lengths);
  const Bytes bytes = encode(whole);
  ASSERT_EQ(lengths.at, bytes.size());
  EXPECT_EQ(lengths.found.empty(), std::is_trivially_copyable_v<TypeParam>);
  for (const std::size_t offset : lengths.found) {
    for (const std::int32_t length : kImpossibleLengths) {
      Bytes hostile = bytes;
      put_int32(hostile, offset, length);
      TypeParam message{};
      EXPECT_FALSE(decode(hostile, message)) << length << " at " << offset;
      Capacity taken;
      visit_fields(message, taken);
      EXPECT_LT(taken.elements, 100U) << length << " at " << offset;
      const bool is_an_empty_array = length == 0 && lengths.counts.contains(offset);
      if (is_an_empty_array) continue;  // the length fits; what follows is left over
      EXPECT_FALSE(lengths_fit<TypeParam>(hostile)) << length << " at " << offset;
    }
  }
}

// By hand: fingerprint 8, utime 8, seq 8, length of "sim" at 24, count at 32, of the first name 36.
TEST(MessageIoLengths, ImpossibleLengthsOfCountersAreRefused) {
  counters_t sent{};
  sent.node = "sim";
  sent.name = {"command.reordered", "", "loop.slips"};
  sent.value = {1, INT64_MIN, INT64_MAX};
  sent.count = 3;
  for (const std::int32_t length : kImpossibleLengths) {
    for (const std::size_t offset : {24U, 32U, 36U}) {
      Bytes bytes = encode(sent);
      put_int32(bytes, offset, length);
      counters_t counters{};
      EXPECT_FALSE(decode(bytes, counters)) << length << " at " << offset;
    }
  }
}

TEST(MessageIoLengths, ATextEndsWithItsOnlyZero) {
  counters_t sent{};
  sent.node = "netem";
  auto bytes = encode(sent);
  const auto text = std::search(bytes.begin(), bytes.end(), sent.node.begin(), sent.node.end());
  counters_t received{};
  text[2] = 0;
  EXPECT_FALSE(decode(bytes, received));
  text[2] = 't';
  EXPECT_TRUE(decode(bytes, received));
  text[5] = 'x';
  EXPECT_FALSE(decode(bytes, received));
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
