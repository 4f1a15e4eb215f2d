#include <gtest/gtest.h>

#include "tests/can_bridge/emulated/drive_rig.hpp"

namespace tether {
namespace {

using test::DriveRig;
using test::two_node_drivetrain;

constexpr std::int64_t kCannotMap = 0x06040041;
constexpr std::int64_t kTooLong = 0x06040042;
constexpr std::int64_t kPdoInvalidValue = 0x06090030;
constexpr std::int64_t kDeviceState = 0x08000022;

/// Node 1's PDOs under a master's hands.
class EmulatedPdo : public ::testing::Test {
 protected:
  EmulatedPdo() {
    rig_.run(400);
    rig_.write(1, 0x1800, 1, 4, 0x80000181);  // the default TPDO1 would only disturb
  }

  std::int64_t write(std::uint16_t index, std::uint8_t sub, int bytes, std::int64_t value) {
    return rig_.write(1, index, sub, bytes, value);
  }
  /// The whole sequence: off, clear, map, count, type, on.
  void map(std::uint16_t communication, std::uint32_t id, int type,
           std::initializer_list<std::uint32_t> objects) {
    const auto mapping = static_cast<std::uint16_t>(communication + 0x200);
    ASSERT_EQ(write(communication, 1, 4, 0x80000000 | id), 0);
    ASSERT_EQ(write(mapping, 0, 1, 0), 0);
    std::uint8_t sub = 0;
    for (const std::uint32_t object : objects) ASSERT_EQ(write(mapping, ++sub, 4, object), 0);
    ASSERT_EQ(write(mapping, 0, 1, sub), 0);
    ASSERT_EQ(write(communication, 2, 1, type), 0);
    ASSERT_EQ(write(communication, 1, 4, id), 0);
  }
  void start() {
    rig_.nmt(0x01, 1);
    rig_.run(1);
    rig_.forget_sent();
  }
  std::int32_t target() { return rig_.read_signed(1, 0x60FF, 0); }

  DriveRig rig_{two_node_drivetrain()};
};

// ---------------------------------------------------------------------------- configuration

TEST_F(EmulatedPdo, MappingsChangeOnlyWhileThePdoIsOff) {
  EXPECT_EQ(write(0x1600, 0, 1, 0), kDeviceState);
  EXPECT_EQ(write(0x1600, 1, 4, 0x60400010), kDeviceState);
  EXPECT_EQ(write(0x1400, 1, 4, 0x80000201), 0);
  EXPECT_EQ(write(0x1600, 1, 4, 0x60400010), kDeviceState) << "count is not 0";
  EXPECT_EQ(write(0x1600, 0, 1, 0), 0);
  EXPECT_EQ(write(0x1600, 1, 4, 0x60FF0020), 0);
}

TEST_F(EmulatedPdo, MapsOnlyWhatTheDriveAllows) {
  write(0x1401, 1, 4, 0x80000301);
  write(0x1601, 0, 1, 0);
  EXPECT_EQ(write(0x1601, 1, 4, 0x12345620), kCannotMap) << "no such object";
  EXPECT_EQ(write(0x1601, 1, 4, 0x60410010), kCannotMap) << "read-only in an RPDO";
  EXPECT_EQ(write(0x1601, 1, 4, 0x10170010), kCannotMap) << "communication object";
  EXPECT_EQ(write(0x1601, 1, 4, 0x60FF0010), kCannotMap) << "half an object";
  EXPECT_EQ(write(0x1A01, 1, 4, 0x60410010), 0);
  EXPECT_EQ(write(0x1A01, 2, 4, 0x10010008), 0) << "the error register may be sent";
}

TEST_F(EmulatedPdo, HoldsEightBytesAndNotOneMore) {
  write(0x1601, 1, 4, 0x60FF0020);
  write(0x1601, 2, 4, 0x60830020);
  write(0x1601, 3, 4, 0x60600008);
  EXPECT_EQ(write(0x1601, 0, 1, 3), kTooLong);
  EXPECT_EQ(write(0x1601, 0, 1, 9), kTooLong);
  EXPECT_EQ(write(0x1601, 0, 1, 4), kCannotMap) << "entry 4 is empty";
  EXPECT_EQ(write(0x1601, 0, 1, 2), 0);
}

TEST_F(EmulatedPdo, SwitchesOnOnlyWithMappingAndAProperIdentifier) {
  EXPECT_EQ(write(0x1401, 1, 4, 0x301), kPdoInvalidValue) << "nothing mapped";
  write(0x1601, 1, 4, 0x60FF0020);
  write(0x1601, 0, 1, 1);
  for (const std::uint32_t id : {0x000u, 0x07Fu, 0x101u, 0x581u, 0x67Fu, 0x701u, 0x20000301u}) {
    EXPECT_EQ(write(0x1401, 1, 4, id), kPdoInvalidValue) << std::hex << id;
  }
  EXPECT_EQ(write(0x1401, 1, 4, 0x301), 0);
  EXPECT_EQ(write(0x1401, 1, 4, 0x302), kPdoInvalidValue) << "not while it is on";
  EXPECT_EQ(rig_.read(1, 0x1401, 1), 0x301);
}

TEST_F(EmulatedPdo, KnowsTheTransmissionTypes) {
  for (const int type : {0, 1, 240, 254, 255}) EXPECT_EQ(write(0x1401, 2, 1, type), 0) << type;
  for (const int type : {241, 252, 253}) {
    EXPECT_EQ(write(0x1401, 2, 1, type), kPdoInvalidValue) << type;
  }
}

TEST_F(EmulatedPdo, InhibitTimeChangesOnlyWhileThePdoIsOff) {
  EXPECT_EQ(write(0x1800, 3, 2, 100), 0);
  map(0x1800, 0x181, 255, {0x60410010});
  EXPECT_EQ(write(0x1800, 3, 2, 200), kDeviceState);
}

// ---------------------------------------------------------------------------- RPDO

TEST_F(EmulatedPdo, AnAsynchronousRpdoActsAtOnceAndOnlyWhenOperational) {
  map(0x1400, 0x201, 255, {0x60400010, 0x60FF0020});
  rig_.send(0x201, {0x06, 0x00, 0x64, 0x00, 0x00, 0x00});
  EXPECT_EQ(target(), 0) << "pre-operational";
  start();
  rig_.send(0x201, {0x06, 0x00, 0x9C, 0xFF, 0xFF, 0xFF});
  EXPECT_EQ(target(), -100);
  rig_.run(1);
  EXPECT_EQ(rig_.state(), 0x21);
  rig_.nmt(0x80, 1);
  rig_.send(0x201, {0x06, 0x00, 0x64, 0x00, 0x00, 0x00});
  EXPECT_EQ(target(), -100) << "pre-operational again";
}

TEST_F(EmulatedPdo, ASynchronousRpdoWaitsForSync) {
  map(0x1400, 0x201, 1, {0x60400010, 0x60FF0020});
  start();
  rig_.send(0x201, {0x06, 0x00, 0x64, 0x00, 0x00, 0x00});
  rig_.run(5);
  EXPECT_EQ(target(), 0);
  rig_.send(0x201, {0x06, 0x00, 0x65, 0x00, 0x00, 0x00});
  rig_.sync();
  EXPECT_EQ(target(), 0x65) << "the newest counts";
}

TEST_F(EmulatedPdo, WhatAnRpdoCarriesFollowsTheMappingThatWasWritten) {
  map(0x1400, 0x201, 255, {0x60FF0020, 0x60400010});  // the other way round
  start();
  rig_.send(0x201, {0x64, 0x00, 0x00, 0x00, 0x06, 0x00});
  EXPECT_EQ(target(), 100);
  EXPECT_EQ(rig_.read(1, 0x6040, 0), 0x06);
}

TEST_F(EmulatedPdo, AnRpdoListensToTheIdentifierThatWasWritten) {
  map(0x1400, 0x345, 255, {0x60FF0020});
  start();
  rig_.send(0x201, {0x64, 0x00, 0x00, 0x00});
  EXPECT_EQ(target(), 0);
  rig_.send(0x345, {0x64, 0x00, 0x00, 0x00});
  EXPECT_EQ(target(), 100);
}

TEST_F(EmulatedPdo, AShortRpdoIsIgnoredWithOneEmcy8210) {
  map(0x1400, 0x201, 255, {0x60400010, 0x60FF0020});
  start();
  for (int i = 0; i < 3; ++i) rig_.send(0x201, {0x06, 0x00, 0x64, 0x00, 0x00});
  EXPECT_EQ(target(), 0);
  EXPECT_EQ(rig_.read(1, 0x6040, 0), 0);
  ASSERT_EQ(rig_.sent(0x081).size(), 1u);
  EXPECT_EQ(rig_.sent(0x081)[0].frame, CanFrame::make(0x081, {0x10, 0x82, 0x11, 0, 0, 0, 0, 0}));
  EXPECT_EQ(rig_.node().counters().rpdo_too_short, 3);
  rig_.send(0x201, {0x06, 0x00, 0x64, 0x00, 0x00, 0x00});
  ASSERT_EQ(rig_.sent(0x081).size(), 2u) << "a good one ends the error";
  EXPECT_EQ(rig_.sent(0x081)[1].frame, CanFrame::make(0x081, {0, 0, 0, 0, 0, 0, 0, 0}));
}

TEST_F(EmulatedPdo, ALongRpdoIsUsedUpToItsMapping) {
  map(0x1400, 0x201, 255, {0x60FF0020});
  start();
  rig_.send(0x201, {0x64, 0x00, 0x00, 0x00, 0x55, 0x55});
  EXPECT_EQ(target(), 100);
}

TEST_F(EmulatedPdo, ValuesOutOfRangeDoNotGetInByRpdo) {
  map(0x1400, 0x201, 255, {0x60600008, 0x60830020});
  start();
  const std::int64_t acceleration = rig_.read(1, 0x6083, 0);
  rig_.send(0x201, {0x07, 0x00, 0x00, 0x00, 0x00});
  EXPECT_EQ(rig_.read(1, 0x6060, 0), 0);
  EXPECT_EQ(rig_.read(1, 0x6083, 0), acceleration);
}

TEST_F(EmulatedPdo, TheRpdoDeadlineStartsWithTheFirstFrameAndFaultsTheDrive) {
  map(0x1400, 0x201, 1, {0x60400010, 0x60FF0020});
  write(0x1400, 5, 2, 100);
  start();
  rig_.run(500);
  EXPECT_TRUE(rig_.sent(0x081).empty()) << "nothing came yet";
  rig_.send(0x201, {0x06, 0x00, 0, 0, 0, 0});
  rig_.run(99);
  EXPECT_TRUE(rig_.sent(0x081).empty());
  rig_.send(0x201, {0x06, 0x00, 0, 0, 0, 0});
  rig_.run(99);
  EXPECT_TRUE(rig_.sent(0x081).empty());
  rig_.run(1);
  ASSERT_EQ(rig_.sent(0x081).size(), 1u);
  EXPECT_EQ(rig_.sent(0x081)[0].frame, CanFrame::make(0x081, {0x50, 0x82, 0x11, 0, 0, 0, 0, 0}));
  rig_.run(1);
  EXPECT_EQ(rig_.state() & 0x4F, 0x08);
  EXPECT_EQ(rig_.read(1, 0x603F, 0), 0x8250);
  rig_.run(1000);
  EXPECT_EQ(rig_.sent(0x081).size(), 1u) << "told once";
}

// ---------------------------------------------------------------------------- TPDO

TEST_F(EmulatedPdo, ASynchronousTpdoComesAtEachNthSync) {
  map(0x1800, 0x181, 3, {0x60410010});
  start();
  for (int i = 1; i <= 7; ++i) {
    rig_.sync();
    EXPECT_EQ(rig_.sent(0x181).size(), static_cast<std::size_t>(i / 3)) << i;
  }
}

TEST_F(EmulatedPdo, ATpdoCarriesWhatWasMappedInThatOrder) {
  map(0x1800, 0x181, 1, {0x60610008, 0x60410010, 0x606C0020});
  start();
  rig_.sync();
  ASSERT_EQ(rig_.sent(0x181).size(), 1u);
  const CanFrame f = rig_.sent(0x181)[0].frame;
  EXPECT_EQ(f.size, 7);
  EXPECT_EQ(f.data[0], 0);
  EXPECT_EQ((f.data[1] | f.data[2] << 8) & 0x6F, 0x40);
}

TEST_F(EmulatedPdo, NoTpdoLeavesOutsideOperational) {
  map(0x1800, 0x181, 1, {0x60410010});
  rig_.sync();
  EXPECT_TRUE(rig_.sent(0x181).empty());
  start();
  rig_.nmt(0x02, 1);
  rig_.sync();
  EXPECT_TRUE(rig_.sent(0x181).empty());
}

TEST_F(EmulatedPdo, AnEventDrivenTpdoComesOnEnteringOperationalAndOnChange) {
  map(0x1800, 0x181, 255, {0x60410010, 0x60640020});
  rig_.nmt(0x01, 1);
  rig_.run(1);
  EXPECT_EQ(rig_.sent(0x181).size(), 1u);
  rig_.run(100);
  EXPECT_EQ(rig_.sent(0x181).size(), 1u) << "nothing changed";
  write(0x6040, 0, 2, 0x06);
  rig_.run(1);
  EXPECT_EQ(rig_.sent(0x181).size(), 2u);
}

TEST_F(EmulatedPdo, MeasuredValuesAloneAreNoEventUnlessAnInhibitTimeBoundsTheRate) {
  map(0x1800, 0x181, 255, {0x60640020});
  rig_.enable_by_sdo();
  write(0x60FF, 0, 4, 600);
  rig_.run(1000);
  start();
  rig_.run(100);
  EXPECT_TRUE(rig_.sent(0x181).empty());
  write(0x1800, 1, 4, 0x80000181);
  write(0x1800, 3, 2, 200);  // 20 ms
  write(0x1800, 1, 4, 0x181);
  rig_.run(1);
  rig_.forget_sent();
  rig_.run(100);
  const auto sent = rig_.sent(0x181);
  ASSERT_EQ(sent.size(), 5u);
  EXPECT_EQ(sent[1].when - sent[0].when, std::chrono::milliseconds{20});
}

TEST_F(EmulatedPdo, TheEventTimerSendsWhatDoesNotChange) {
  map(0x1800, 0x181, 255, {0x60640020});
  write(0x1800, 5, 2, 50);
  start();
  rig_.run(49);
  EXPECT_TRUE(rig_.sent(0x181).empty());
  rig_.run(1);
  EXPECT_EQ(rig_.sent(0x181).size(), 1u);
  rig_.run(100);
  EXPECT_EQ(rig_.sent(0x181).size(), 3u);
}

TEST_F(EmulatedPdo, TransmissionType0WaitsForAnEventAndThenForSync) {
  map(0x1800, 0x181, 0, {0x60410010});
  start();
  rig_.sync();
  EXPECT_EQ(rig_.sent(0x181).size(), 1u) << "entering operational was an event";
  rig_.run(2);
  rig_.sync();
  EXPECT_EQ(rig_.sent(0x181).size(), 1u);
  write(0x6040, 0, 2, 0x06);
  rig_.run(2);
  EXPECT_EQ(rig_.sent(0x181).size(), 1u);
  rig_.sync();
  EXPECT_EQ(rig_.sent(0x181).size(), 2u);
}

}  // namespace
}  // namespace tether
