#include <gtest/gtest.h>

#include <limits>
#include <map>
#include <string>

#include "can_bridge/agilex/config.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/safety/command_watch.hpp"
#include "can_bridge/safety/request_guard.hpp"
#include "can_bridge/safety/transmit_whitelist.hpp"

// Inputs (commands, requests) and permitted outputs (frames).

namespace tether {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using std::chrono::seconds;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr Instant kNow = kStart + seconds{10};

template <class Guard>
std::map<std::string, std::int64_t> counters(const Guard& guard) {
  CounterList list;
  guard.list(list);
  return {list.begin(), list.end()};
}

TEST(CommandWatch, KnowsNoAgeBeforeTheFirstCommand) {
  const CommandWatch watch{StreamGuard::Config{}};
  EXPECT_FALSE(watch.age(kNow));
  EXPECT_FALSE(watch.is_zero(kNow)) << "no command is not a zero command";
}

TEST(CommandWatch, AgeCountsFromTheStampSoThatTheNetworksDelayCounts) {
  CommandWatch watch{StreamGuard::Config{}};
  EXPECT_TRUE(watch.offer(kNow, kNow - milliseconds{70}, 0, {1.0, 0.0}));
  EXPECT_EQ(watch.age(kNow), milliseconds{70});
  EXPECT_EQ(watch.age(kNow + milliseconds{5}), milliseconds{75});
}

TEST(CommandWatch, AgeOfAStampAheadOfUsCountsFromTheArrival) {
  CommandWatch watch{StreamGuard::Config{}};
  EXPECT_TRUE(watch.offer(kNow, kNow + seconds{1}, 0, {1.0, 0.0}));
  EXPECT_EQ(watch.age(kNow), Duration{0});
  EXPECT_EQ(watch.age(kNow + milliseconds{5}), milliseconds{5});
}

TEST(CommandWatch, RejectedCommandsChangeNeitherTwistNorAge) {
  CommandWatch watch{StreamGuard::Config{}};
  ASSERT_TRUE(watch.offer(kNow, kNow, 5, {1.0, 0.5}));
  const Instant later = kNow + milliseconds{100};
  EXPECT_FALSE(watch.offer(later, later, 6, {kNaN, 0.0}));
  EXPECT_FALSE(watch.offer(later, later, 7, {0.0, -kLargestUsable}));
  EXPECT_FALSE(watch.offer(later, kNow, 5, {2.0, 0.0}));
  EXPECT_FALSE(watch.offer(later, kNow - milliseconds{1}, 4, {2.0, 0.0}));
  EXPECT_FALSE(watch.offer(later, later + seconds{1} + nanoseconds{1}, 8, {2.0, 0.0}));
  EXPECT_FALSE(watch.offer(later, kStart - nanoseconds{1}, 9, {2.0, 0.0}));
  EXPECT_EQ(watch.age(later), milliseconds{100});
  EXPECT_EQ(watch.twist(later).v_mps, 1.0);
  const auto counted = counters(watch);
  EXPECT_EQ(counted.at("command.accepted"), 1);
  EXPECT_EQ(counted.at("command.non_finite"), 2);
  EXPECT_EQ(counted.at("command.duplicated"), 1);
  EXPECT_EQ(counted.at("command.reordered"), 1);
  EXPECT_EQ(counted.at("command.from_future"), 1);
  EXPECT_EQ(counted.at("command.before_start"), 1);
}

TEST(CommandWatch, ZeroIsBelowAMillimetreAndAMilliradianPerSecond) {
  const auto is_zero = [](double v_mps, double omega_radps) {
    CommandWatch watch{StreamGuard::Config{}};
    watch.offer(kNow, kNow, 0, {v_mps, omega_radps});
    return watch.is_zero(kNow);
  };
  EXPECT_TRUE(is_zero(0.0, 0.0));
  EXPECT_TRUE(is_zero(-0.00099, 0.00099));
  EXPECT_FALSE(is_zero(0.001, 0.0));
  EXPECT_FALSE(is_zero(-0.001, 0.0));
  EXPECT_FALSE(is_zero(0.0, -0.001));
}

TEST(RequestGuard, LetsEachFreshRequestThroughOnce) {
  RequestGuard guard{kStart};
  EXPECT_EQ(guard.accept(kNow, kNow - seconds{1}, 0, 1), DriveRequest::arm);
  EXPECT_FALSE(guard.accept(kNow, kNow - seconds{1}, 0, 1));
  EXPECT_EQ(guard.accept(kNow, kNow, 1, 5), DriveRequest::reset);
  EXPECT_FALSE(guard.accept(kNow, kNow - milliseconds{1}, 0, 1)) << "older than the newest";
}

TEST(RequestGuard, RejectsWhatIsTooOldOrOfTheFuture) {
  RequestGuard guard{kStart};
  EXPECT_FALSE(guard.accept(kNow, kNow - RequestGuard::kFresh - nanoseconds{1}, 0, 1));
  EXPECT_FALSE(guard.accept(kNow, kNow + RequestGuard::kMaxAhead + nanoseconds{1}, 1, 1));
  EXPECT_FALSE(guard.accept(kNow, from_utime(INT64_MAX), 2, 1));
  EXPECT_FALSE(guard.accept(kNow, from_utime(INT64_MIN), 3, 1));
  EXPECT_EQ(counters(guard).at("request.stale"), 2);
  EXPECT_EQ(counters(guard).at("request.from_future"), 2);
  EXPECT_TRUE(guard.accept(kNow, kNow, 0, 1)) << "what was rejected left no trace";
}

TEST(RequestGuard, RefusesWhatWasStampedBeforeTheBridgeStarted) {
  RequestGuard guard{kStart};
  guard.start(kNow);
  guard.start(kNow + seconds{1});  // it starts once
  const Instant later = kNow + milliseconds{200};
  EXPECT_FALSE(guard.accept(later, kNow - nanoseconds{1}, 0, 4));
  EXPECT_FALSE(guard.accept(later, kNow - nanoseconds{1}, 1, 6));
  EXPECT_EQ(counters(guard).at("request.before_start"), 1) << "an ALIVE is not counted";
  EXPECT_EQ(guard.accept(later, kNow - seconds{5}, 2, 3), DriveRequest::estop);
  EXPECT_EQ(guard.accept(later, kNow - seconds{5}, 3, 2), DriveRequest::disarm);
  EXPECT_EQ(guard.accept(later, kNow, 0, 5), DriveRequest::reset);
}

TEST(RequestGuard, AnEStopActsWhateverItsStamp) {
  RequestGuard guard{kStart};
  EXPECT_TRUE(guard.accept(kNow, kNow, 7, 1));
  EXPECT_EQ(guard.accept(kNow, kNow, 7, 3), DriveRequest::estop);
  EXPECT_EQ(guard.accept(kNow, kNow - seconds{5}, 6, 3), DriveRequest::estop);
  EXPECT_EQ(guard.accept(kNow, kNow + seconds{5}, 8, 3), DriveRequest::estop);
}

TEST(RequestGuard, LetsALateOrRepeatedDisarmThrough) {
  RequestGuard guard(kStart);
  EXPECT_EQ(guard.accept(kNow, kNow, 7, 2), DriveRequest::disarm);
  EXPECT_EQ(guard.accept(kNow, kNow, 7, 2), DriveRequest::disarm);
  EXPECT_EQ(guard.accept(kNow, kNow - seconds{5}, 6, 2), DriveRequest::disarm);
}

TEST(RequestGuard, CountsNumbersThatAreNoRequest) {
  RequestGuard guard{kStart};
  for (const int number : {0, 7, -1, INT32_MIN, INT32_MAX}) {
    EXPECT_FALSE(guard.accept(kNow, kNow, 0, number));
  }
  EXPECT_EQ(counters(guard).at("request.unknown"), 5);
}

/// Two nodes, RPDO1 = controlword + target velocity, as in most drives.
Cia402Config two_nodes() {
  Cia402Config config;
  config.axes[0].node = 1;
  config.axes[1].node = 2;
  for (const std::uint8_t node : {1, 2}) {
    PdoConfig rpdo;
    rpdo.node = node;
    rpdo.objects = {config.axes[0].controlword, config.axes[0].target_velocity};
    config.pdos.push_back(rpdo);
    PdoConfig tpdo;
    tpdo.node = node;
    tpdo.transmit = true;
    tpdo.objects = {config.axes[0].statusword, config.axes[0].actual_velocity};
    config.pdos.push_back(tpdo);
  }
  return config;
}

TEST(TransmitWhitelist, ASetpointPassesOnlyWhileMovingIsAllowed) {
  TransmitWhitelist whitelist{two_nodes().transmit_rules()};
  const CanFrame fast = CanFrame::make(0x201, {0x0F, 0x00, 0xE8, 0x03, 0x00, 0x00});
  CanFrame frame = fast;
  EXPECT_TRUE(whitelist.pass(frame, true));
  EXPECT_EQ(frame, fast);
  EXPECT_TRUE(whitelist.pass(frame, false));
  EXPECT_EQ(frame, CanFrame::make(0x201, {0x0F, 0x00, 0x00, 0x00, 0x00, 0x00}));
  EXPECT_EQ(whitelist.counters().zeroed, 1);
}

TEST(TransmitWhitelist, AQuickStopWithAForgottenSetpointStillGoesOut) {
  TransmitWhitelist whitelist{two_nodes().transmit_rules()};
  CanFrame frame = CanFrame::make(0x202, {0x02, 0x00, 0x18, 0xFC, 0xFF, 0xFF});
  EXPECT_TRUE(whitelist.pass(frame, false));
  EXPECT_EQ(frame, CanFrame::make(0x202, {0x02, 0x00, 0x00, 0x00, 0x00, 0x00}));
}

TEST(TransmitWhitelist, WhatCarriesNoSetpointIsLeftAlone) {
  TransmitWhitelist whitelist{two_nodes().transmit_rules()};
  for (const CanFrame& frame :
       {CanFrame::make(0x000, {0x01, 0x00}), CanFrame::make(0x080, {}),
        CanFrame::make(0x77F, {0x05}),
        CanFrame::make(0x601, {0x23, 0x83, 0x60, 0x00, 0xE8, 0x03, 0x00, 0x00}),
        CanFrame::make(0x602, {0x23, 0xFF, 0x60, 0x00, 0x00, 0x00, 0x00, 0x00}),
        CanFrame::make(0x602, {0x40, 0xFF, 0x60, 0x00, 0x01, 0x00, 0x00, 0x00})}) {
    CanFrame sent = frame;
    EXPECT_TRUE(whitelist.pass(sent, false)) << std::hex << frame.id;
    EXPECT_EQ(sent, frame);
  }
  EXPECT_EQ(whitelist.counters().zeroed, 0);
  EXPECT_EQ(whitelist.counters().denied, 0);
}

TEST(TransmitWhitelist, ASetpointBySdoIsDeniedEvenWhileMoving) {
  TransmitWhitelist whitelist{two_nodes().transmit_rules()};
  CanFrame frame = CanFrame::make(0x602, {0x23, 0xFF, 0x60, 0x00, 0x01, 0x00, 0x00, 0x00});
  EXPECT_FALSE(whitelist.pass(frame, false));
  EXPECT_FALSE(whitelist.pass(frame, true));
  CanFrame block = CanFrame::make(0x602, {0xC6, 0xFF, 0x60, 0x00, 0x04, 0x00, 0x00, 0x00});
  EXPECT_FALSE(whitelist.pass(block, true));
}

TEST(TransmitWhitelist, BySdoAControlwordOnlyStops) {
  TransmitWhitelist whitelist{two_nodes().transmit_rules()};
  for (const int word : {0x0000, 0x0002, 0x0003, 0x0006, 0x0007, 0x000F, 0x0080, 0x0102}) {
    const bool stops = word == 0x0000 || word == 0x0002;
    for (const bool may_move : {false, true}) {
      CanFrame frame =
          CanFrame::make(0x601, {0x2B, 0x40, 0x60, 0x00, static_cast<std::uint8_t>(word & 0xFF),
                                 static_cast<std::uint8_t>(word >> 8), 0x00, 0x00});
      EXPECT_EQ(whitelist.pass(frame, may_move), stops) << std::hex << word;
    }
  }
  CanFrame reading = CanFrame::make(0x601, {0x40, 0x40, 0x60, 0x00, 0x0F, 0, 0, 0});
  EXPECT_TRUE(whitelist.pass(reading, false));
  CanFrame segmented = CanFrame::make(0x601, {0x21, 0x40, 0x60, 0x00, 0x02, 0, 0, 0});
  EXPECT_FALSE(whitelist.pass(segmented, false)) << "two bytes of an unknown value";
}

TEST(TransmitWhitelist, FramesThatNoBridgeSendsAreDeniedEvenWhileMoving) {
  TransmitWhitelist whitelist{two_nodes().transmit_rules()};
  for (const std::uint32_t id : {0x081, 0x181, 0x203, 0x301, 0x581, 0x603, 0x701, 0x7FF}) {
    CanFrame frame = CanFrame::make(id, {0});
    EXPECT_FALSE(whitelist.pass(frame, true)) << std::hex << id;
  }
  CanFrame extended = CanFrame::make(0x201, {0x0F, 0x00, 0, 0, 0, 0});
  extended.extended = true;
  EXPECT_FALSE(whitelist.pass(extended, true));
  CanFrame remote = CanFrame::make(0x201, {});
  remote.remote = true;
  EXPECT_FALSE(whitelist.pass(remote, true));
  EXPECT_EQ(whitelist.counters().denied, 10);
}

/// Rules of a profile whose drives have 29-bit identifiers.
TEST(TransmitWhitelist, LongIdentifiersPassWhereTheRulesNameThemAndOnlyAsSuch) {
  constexpr std::uint32_t kCommand = 0x0CEF1001, kAsSdo = 0x601;
  TransmitRules rules;
  rules.frames = {{kCommand, 0x03, true}, {kAsSdo, 0, true}};
  rules.sdo_ids = {kAsSdo};
  rules.setpoints = {{0x60FF, 0, 4, true}};
  TransmitWhitelist whitelist{rules};
  CanFrame frame = CanFrame::make(kCommand, {7, 8, 9});
  EXPECT_FALSE(whitelist.pass(frame, true)) << "not as an identifier of 11 bits";
  frame.extended = true;
  EXPECT_TRUE(whitelist.pass(frame, true));
  EXPECT_EQ(frame.data[0], 7);
  EXPECT_TRUE(whitelist.pass(frame, false));
  EXPECT_EQ(frame.data, (std::array<std::uint8_t, 8>{0, 0, 9}));
  CanFrame no_sdo = CanFrame::make(kAsSdo, {0x23, 0xFF, 0x60, 0x00, 1, 0, 0, 0});
  no_sdo.extended = true;
  EXPECT_TRUE(whitelist.pass(no_sdo, true)) << "SDO has 11 bits";
}

TEST(TransmitWhitelist, FindsBothSetpointsInOneFrameOfADualAxisNode) {
  Cia402Config config;
  config.axes[0].target_velocity = {0x60FF, 1, 2, true};
  config.axes[1].target_velocity = {0x60FF, 2, 2, true};
  PdoConfig rpdo;
  rpdo.number = 2;
  rpdo.objects = {config.axes[0].target_velocity, config.axes[0].controlword,
                  config.axes[1].target_velocity};
  config.pdos = {rpdo};
  TransmitWhitelist whitelist{config.transmit_rules()};
  CanFrame frame = CanFrame::make(0x301, {1, 2, 3, 4, 5, 6});
  EXPECT_TRUE(whitelist.pass(frame, false));
  EXPECT_EQ(frame, CanFrame::make(0x301, {0, 0, 3, 4, 0, 0}));
}

TEST(TransmitWhitelist, KnowsAgilexFrames) {
  TransmitWhitelist whitelist{AgilexV2Config{}.transmit_rules()};
  CanFrame motion = CanFrame::make(0x111, {0x01, 0xF4, 0, 0x64, 0, 0, 0, 0});
  EXPECT_TRUE(whitelist.pass(motion, false));
  EXPECT_EQ(motion, CanFrame::make(0x111, {0, 0, 0, 0, 0, 0, 0, 0}));
  CanFrame mode = CanFrame::make(0x421, {1, 0, 0, 0, 0, 0, 0, 0});
  EXPECT_TRUE(whitelist.pass(mode, false));
  EXPECT_EQ(mode.data[0], 1);
  CanFrame other = CanFrame::make(0x211, {0});
  EXPECT_FALSE(whitelist.pass(other, true));
}

}  // namespace
}  // namespace tether
