#include "netem/echo_filter.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/virtual_world.hpp"

namespace tether {
namespace {

using testing::at_s;

/// A filter that remembers for 10 s, up to 4 messages.
struct EchoFilterTest : ::testing::Test {
  using Bytes = std::vector<std::uint8_t>;

  void publish(double t_s, const std::string& channel, const Bytes& bytes, std::size_t net = 0) {
    filter.published(at_s(t_s), net, {channel, bytes});
  }
  bool heard(double t_s, const std::string& channel, const Bytes& bytes, std::size_t net = 0) {
    return filter.heard(at_s(t_s), net, {channel, bytes});
  }

  EchoFilter filter{std::chrono::seconds{10}, 4};
};

TEST_F(EchoFilterTest, WhatWasPublishedIsRecognisedOnce) {
  publish(0.0, "FOO", {1, 2});
  EXPECT_TRUE(heard(0.1, "FOO", {1, 2}));
  EXPECT_FALSE(heard(0.2, "FOO", {1, 2}));
  EXPECT_EQ(filter.counters().recognised, 1);
  EXPECT_EQ(filter.size(), 0U);
}

TEST_F(EchoFilterTest, OnlyNetworkChannelAndBytesTogetherAreTheMessage) {
  publish(0.0, "FOO", {1, 2});
  EXPECT_FALSE(heard(0.1, "FOO", {1, 2}, 1));
  EXPECT_FALSE(heard(0.1, "BAR", {1, 2}));
  EXPECT_FALSE(heard(0.1, "FOO", {1, 3}));
  EXPECT_FALSE(heard(0.1, "FOO", {1, 2, 0}));
  EXPECT_FALSE(heard(0.1, "FOO", {}));
  EXPECT_TRUE(heard(0.1, "FOO", {1, 2}));
}

TEST_F(EchoFilterTest, AnEmptyMessageIsAMessage) {
  EXPECT_FALSE(heard(0.0, "FOO", {}));
  publish(0.0, "FOO", {});
  EXPECT_TRUE(heard(0.1, "FOO", {}));
}

TEST_F(EchoFilterTest, AsManyAreRecognisedAsWerePublished) {
  publish(0.0, "FOO", {7});
  publish(0.0, "FOO", {7});
  EXPECT_TRUE(heard(0.1, "FOO", {7}));
  EXPECT_TRUE(heard(0.1, "FOO", {7}));
  EXPECT_FALSE(heard(0.1, "FOO", {7}));
}

TEST_F(EchoFilterTest, OfEqualMessagesInAnyOrderAllForeignOnesGetThrough) {
  int own = 0;
  for (int i = 0; i < 100; ++i) {
    const double t_s = 0.1 * i;
    own += heard(t_s, "BEAT", {7}) ? 1 : 0;  // somebody else's, before and …
    publish(t_s, "BEAT", {7});
    own += heard(t_s, "BEAT", {7}) ? 1 : 0;  // … after, or ours
    own += heard(t_s, "BEAT", {7}) ? 1 : 0;
  }
  EXPECT_EQ(own, 100);
}

TEST_F(EchoFilterTest, WhatIsNotHeardIsForgottenInTimeAndCounted) {
  publish(0.0, "FOO", {1});
  publish(5.0, "FOO", {1});
  EXPECT_TRUE(heard(9.9, "FOO", {1}));
  EXPECT_TRUE(heard(14.9, "FOO", {1}));
  publish(20.0, "FOO", {1});
  EXPECT_FALSE(heard(30.0, "FOO", {1}));
  EXPECT_EQ(filter.counters().unheard, 1);
  EXPECT_EQ(filter.size(), 0U);
}

TEST_F(EchoFilterTest, ALostOneDoesNotHoldUpTheOthers) {
  publish(0.0, "LOST", {1});
  publish(1.0, "FOO", {2});
  EXPECT_TRUE(heard(1.1, "FOO", {2}));
  EXPECT_FALSE(heard(1.2, "FOO", {2}));
  EXPECT_FALSE(heard(20.0, "LOST", {1}));
  EXPECT_EQ(filter.counters().unheard, 1);
  EXPECT_EQ(filter.counters().recognised, 1);
  EXPECT_EQ(filter.size(), 0U);
}

TEST_F(EchoFilterTest, MemoryIsBoundedAndTheOldestGo) {
  for (std::uint8_t i = 0; i < 10; ++i) publish(0.0, "FOO", {i});
  EXPECT_EQ(filter.size(), 4U);
  EXPECT_EQ(filter.counters().forgotten, 6);
  EXPECT_FALSE(heard(0.1, "FOO", {5}));
  for (std::uint8_t i = 6; i < 10; ++i) EXPECT_TRUE(heard(0.1, "FOO", {i}));
  EXPECT_EQ(filter.size(), 0U);
}

}  // namespace
}  // namespace tether
