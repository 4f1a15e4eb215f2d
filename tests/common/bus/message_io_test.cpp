#include "common/node/message_io.hpp"

#include <fmt/format.h>
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

#include "common/node/counter_reporter.hpp"
#include "common/node/in_process_bus.hpp"
#include "common/node/virtual_loop.hpp"

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

/// Result of decoding: the message encoded again, and the number of elements in its arrays.
struct Decoded {
  bool accepted;
  Bytes again;
  std::size_t elements;
};

/// A message of each kind that exists, behind functions that know its type.
struct MessageKind {
  Bytes bytes;  // a message with different values in all fields, encoded
  bool has_lengths;
  LengthOffsets lengths;
  Decoded (*decode)(const Bytes&);
  bool (*lengths_fit)(const Bytes&);
};

template <class LcmType>
MessageKind kind() {
  LcmType message{};
  visit_fields(message, Filler{});
  MessageKind kind{encode(message), !std::is_trivially_copyable_v<LcmType>, {}, nullptr, nullptr};
  visit_fields(message, kind.lengths);
  kind.decode = [](const Bytes& bytes) {
    LcmType received{};
    const bool accepted = decode(bytes, received);
    Capacity taken;
    visit_fields(received, taken);
    return Decoded{accepted, accepted ? encode(received) : Bytes{}, taken.elements};
  };
  kind.lengths_fit = [](const Bytes& bytes) { return lengths_fit<LcmType>(bytes); };
  return kind;
}

template <class... LcmTypes>
struct Messages {
  static std::map<std::string, MessageKind> all() {
    return {{every_kind_t::getTypeName(), kind<every_kind_t>()},
            {LcmTypes::getTypeName(), kind<LcmTypes>()}...};
  }
};
const std::map<std::string, MessageKind> kMessages = AllMessages<Messages>::all();

TEST(MessageIo, AMessageSurvivesEncodingAndDecoding) {
  for (const auto& [name, kind] : kMessages)
    EXPECT_EQ(kind.decode(kind.bytes).again, kind.bytes) << name;
}

TEST(MessageIo, EveryTruncationIsRefused) {
  for (const auto& [name, kind] : kMessages) {
    for (std::size_t size = 0; size < kind.bytes.size(); ++size) {
      // A copy of its own, so that AddressSanitizer sees every byte read beyond it.
      const Bytes truncated(kind.bytes.begin(),
                            kind.bytes.begin() + static_cast<std::ptrdiff_t>(size));
      EXPECT_FALSE(kind.decode(truncated).accepted) << name << ", " << size << " bytes";
    }
  }
}

TEST(MessageIo, AByteTooManyIsRefused) {
  for (const auto& [name, kind] : kMessages) {
    Bytes bytes = kind.bytes;
    bytes.push_back(0);
    EXPECT_FALSE(kind.decode(bytes).accepted) << name;
  }
}

TEST(MessageIo, RandomBytesAreRefused) {
  std::mt19937 random(1);
  for (const auto& [name, kind] : kMessages) {
    for (int i = 0; i < 2000; ++i) {
      Bytes bytes(random() % 300);
      for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
      EXPECT_FALSE(kind.decode(bytes).accepted) << name;
    }
  }
}

TEST(MessageIo, ADamagedMessageOfTheRightTypeIsDecodedWholeOrRefused) {
  std::mt19937 random(2);
  for (const auto& [name, kind] : kMessages) {
    for (int i = 0; i < 5000; ++i) {
      Bytes damaged = kind.bytes;
      for (std::size_t n = random() % 8 + 1; n > 0; --n) {
        damaged[8 + random() % (damaged.size() - 8)] = static_cast<std::uint8_t>(random());
      }
      const Decoded decoded = kind.decode(damaged);
      EXPECT_TRUE(!decoded.accepted || decoded.again.size() == damaged.size()) << name;
    }
  }
}

TEST(MessageIo, AnotherTypeIsRefused) {
  for (const auto& [sent, message] : kMessages) {
    for (const auto& [name, kind] : kMessages) {
      EXPECT_EQ(kind.decode(message.bytes).accepted, name == sent) << sent << " as " << name;
    }
  }
}

TEST(MessageIo, EveryImpossibleLengthIsRefusedBeforeMemoryIsTaken) {
  for (const auto& [name, kind] : kMessages) {
    ASSERT_EQ(kind.lengths.at, kind.bytes.size()) << name;
    EXPECT_EQ(kind.lengths.found.empty(), !kind.has_lengths) << name;
    for (const std::size_t offset : kind.lengths.found) {
      for (const std::int32_t length : kImpossibleLengths) {
        const std::string what = fmt::format("{}, {} at {}", name, length, offset);
        Bytes hostile = kind.bytes;
        put_int32(hostile, offset, length);
        const Decoded decoded = kind.decode(hostile);
        EXPECT_FALSE(decoded.accepted) << what;
        EXPECT_LT(decoded.elements, 100U) << what;
        const bool is_an_empty_array = length == 0 && kind.lengths.counts.contains(offset);
        if (is_an_empty_array) continue;  // the length fits; what follows is left over
        EXPECT_FALSE(kind.lengths_fit(hostile)) << what;
      }
    }
  }
}

// Manual count: fingerprint 8, utime 8, seq 8, length of "sim" at 24, count at 32, of the first
// name 36.
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
