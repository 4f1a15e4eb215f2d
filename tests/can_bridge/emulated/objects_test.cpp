#include <gtest/gtest.h>

#include <string>

#include "can_bridge/bus/object_dictionary.hpp"
#include "tests/can_bridge/emulated/drive_rig.hpp"

namespace tether {
namespace {

using test::DriveRig;
using test::two_node_drivetrain;

constexpr std::int64_t kReadOnly = 0x06010002;
constexpr std::int64_t kNoObject = 0x06020000;
constexpr std::int64_t kWrongLength = 0x06070010;
constexpr std::int64_t kNoSubindex = 0x06090011;
constexpr std::int64_t kInvalidValue = 0x06090030;
constexpr std::int64_t kUnknownCommand = 0x05040001;
constexpr std::int64_t kToggle = 0x05030000;

DriveRig booted(const Cia402Config& config = two_node_drivetrain()) {
  DriveRig rig(config);
  rig.run(400);
  return rig;
}

// ---------------------------------------------------------------------------- dictionary

TEST(ObjectDictionary, KeepsWhatFitsIntoAnEntryAsARegisterDoes) {
  ObjectDictionary d;
  const auto i16 = d.add({.ref = {0x2000, 0, 2, true}});
  const auto u16 = d.add({.ref = {0x2001, 0, 2, false}});
  d.store(i16, 0x18000);
  d.store(u16, 0x18000);
  EXPECT_EQ(d.value(i16), -0x8000);
  EXPECT_EQ(d.value(u16), 0x8000);
}

TEST(ObjectDictionary, GivesRecordsTheirHighestSubindex) {
  ObjectDictionary d;
  d.add({.ref = {0x2000, 2, 4, false}});
  d.add({.ref = {0x2000, 1, 4, false}});
  d.close_records();
  EXPECT_EQ(d.value(d.find(0x2000, 0)), 2);
  EXPECT_EQ(d.find(0x2000, 3), ObjectDictionary::kNone);
}

TEST(ObjectDictionary, PackedObjectsAreTheirHalves) {
  ObjectDictionary d;
  const auto left = d.add({.ref = {0x60FF, 1, 4, true}});
  const auto right = d.add({.ref = {0x60FF, 2, 4, true}});
  const auto both = d.add({.ref = {0x60FF, 3, 4, false}, .low_half = left, .high_half = right});
  d.store(both, 0xFFFE'0005);
  EXPECT_EQ(d.value(left), 5);
  EXPECT_EQ(d.value(right), -2);
  d.store(left, -1);
  EXPECT_EQ(d.value(both), 0xFFFE'FFFF);
}

TEST(ObjectDictionary, RestoresOnlyTheIndicesAskedFor) {
  ObjectDictionary d;
  const auto a = d.add({.ref = {0x1017, 0, 2, false}, .initial = 7});
  const auto b = d.add({.ref = {0x6083, 0, 4, false}, .initial = 8});
  d.store(a, 100);
  d.store(b, 100);
  d.restore(0x1000, 0x1FFF);
  EXPECT_EQ(d.value(a), 7);
  EXPECT_EQ(d.value(b), 100);
}

// ---------------------------------------------------------------------------- what is there

TEST(EmulatedObjects, HaveTheIdentityOfAServoDrive) {
  DriveRig rig = booted();
  EXPECT_EQ(rig.read(1, 0x1000, 0), 0x00020192);
  EXPECT_EQ(rig.read(2, 0x1018, 4), 2);
  EXPECT_EQ(rig.read(1, 0x6502, 0), 0x04);
}

TEST(EmulatedObjects, HaveNoHeartbeatConsumerUnlessTheConfigurationKnowsOne) {
  Cia402Config config = two_node_drivetrain();
  config.watchdogs = {
      {.node = 1, .kind = WatchdogConfig::Kind::milliseconds, .object = {0x2000, 0, 2, false}}};
  DriveRig rig = booted(config);
  EXPECT_EQ(rig.abort_of_read(1, 0x1016, 1), kNoObject);
  EXPECT_EQ(rig.read(1, 0x2000, 0), 0) << "off after power-on";
  EXPECT_EQ(rig.abort_of_read(2, 0x2000, 0), kNoObject) << "mentioned for node 1 only";
}

TEST(EmulatedObjects, HaveOptionCodesOnlyIfTheConfigurationMentionsThem) {
  Cia402Config config = two_node_drivetrain();
  config.setup.clear();
  DriveRig rig = booted(config);
  for (const std::uint16_t index : {0x1029, 0x6007, 0x605A, 0x605E}) {
    EXPECT_EQ(rig.abort_of_read(1, index, 0), kNoObject) << std::hex << index;
  }
  EXPECT_EQ(rig.read(1, 0x6083, 0), 120) << "two revolutions/s² in rpm/s";
  EXPECT_EQ(rig.read(1, 0x6085, 0), 240);
}

TEST(EmulatedObjects, StartWithWatchdogHeartbeatAndModeOff) {
  DriveRig rig = booted();
  EXPECT_EQ(rig.read(1, 0x1016, 1), 0);
  EXPECT_EQ(rig.read(1, 0x1017, 0), 0);
  EXPECT_EQ(rig.read(1, 0x6061, 0), 0);
}

TEST(EmulatedObjects, MapControlwordAndStatuswordByDefaultAsTheDriveProfileSays) {
  DriveRig rig = booted();
  EXPECT_EQ(rig.read(1, 0x1400, 1), 0x201);
  EXPECT_EQ(rig.read(1, 0x1600, 0), 1);
  EXPECT_EQ(rig.read(1, 0x1600, 1), 0x60400010);
  EXPECT_EQ(rig.read(1, 0x1A00, 1), 0x60410010);
  EXPECT_EQ(rig.read(1, 0x1401, 1), 0x80000301);
  EXPECT_EQ(rig.read(2, 0x1803, 1), 0x80000482);
}

TEST(EmulatedObjects, HavePresetMappingsFromPowerOn) {
  Cia402Config config = two_node_drivetrain();
  config.pdos[0].preset = true;
  config.pdos[0].event_timer_ms = 0;
  DriveRig rig = booted(config);
  EXPECT_EQ(rig.read(1, 0x1400, 2), 1);
  EXPECT_EQ(rig.read(1, 0x1600, 0), 2);
  EXPECT_EQ(rig.read(1, 0x1600, 2), 0x60FF0020);
}

// ---------------------------------------------------------------------------- SDO

TEST(SdoServer, AnswersAnExpeditedWriteAndReadByteForByte) {
  DriveRig rig = booted();
  rig.forget_sent();
  rig.send(0x601, {0x2B, 0x17, 0x10, 0x00, 0x64, 0x00, 0x00, 0x00});
  rig.send(0x601, {0x40, 0x17, 0x10, 0x00, 0x00, 0x00, 0x00, 0x00});
  ASSERT_EQ(rig.sent().size(), 2u);
  EXPECT_EQ(rig.sent()[0].frame, CanFrame::make(0x581, {0x60, 0x17, 0x10, 0, 0, 0, 0, 0}));
  EXPECT_EQ(rig.sent()[1].frame, CanFrame::make(0x581, {0x4B, 0x17, 0x10, 0, 0x64, 0, 0, 0}));
}

TEST(SdoServer, AbortsByteForByte) {
  DriveRig rig = booted();
  rig.forget_sent();
  rig.send(0x602, {0x40, 0x34, 0x12, 0x05, 0, 0, 0, 0});
  ASSERT_EQ(rig.sent().size(), 1u);
  EXPECT_EQ(rig.sent()[0].frame, CanFrame::make(0x582, {0x80, 0x34, 0x12, 0x05, 0, 0, 0x02, 0x06}));
}

TEST(SdoServer, SaysWhatIsWrongWithARequest) {
  DriveRig rig = booted();
  EXPECT_EQ(rig.write(1, 0x2345, 0, 2, 1), kNoObject);
  EXPECT_EQ(rig.write(1, 0x6060, 1, 1, 3), kNoSubindex);
  EXPECT_EQ(rig.write(1, 0x1016, 2, 4, 0), kNoSubindex);
  EXPECT_EQ(rig.write(1, 0x6041, 0, 2, 0), kReadOnly);
  EXPECT_EQ(rig.write(1, 0x6060, 0, 2, 3), kWrongLength);
  EXPECT_EQ(rig.write(1, 0x6083, 0, 2, 3), kWrongLength);
  EXPECT_EQ(rig.write(1, 0x6083, 0, 4, 0), kInvalidValue);
  EXPECT_EQ(rig.write(1, 0x6007, 0, 2, 4), kInvalidValue);
  EXPECT_EQ(rig.write(1, 0x1029, 1, 1, 3), kInvalidValue);
  EXPECT_EQ(rig.node().counters().sdo_aborts, 9);
}

TEST(SdoServer, RefusedWritesChangeNothing) {
  DriveRig rig = booted();
  EXPECT_EQ(rig.write(1, 0x6007, 0, 2, 3), 0);
  EXPECT_EQ(rig.write(1, 0x6007, 0, 2, -1), kInvalidValue);
  EXPECT_EQ(rig.write(1, 0x6007, 0, 1, 2), kWrongLength);
  EXPECT_EQ(rig.read(1, 0x6007, 0), 3);
}

TEST(SdoServer, KnowsWhichOptionCodesAndModesTheDriveHas) {
  DriveRig rig = booted();
  for (const int code : {0, 1, 2, 5, 6}) EXPECT_EQ(rig.write(1, 0x605A, 0, 2, code), 0) << code;
  for (const int code : {-1, 3, 4, 7, 8}) {
    EXPECT_EQ(rig.write(1, 0x605A, 0, 2, code), kInvalidValue) << code;
  }
  for (const int mode : {1, 2, 4, -1, 9}) {
    EXPECT_EQ(rig.write(1, 0x6060, 0, 1, mode), kInvalidValue) << mode;
  }
  EXPECT_EQ(rig.write(1, 0x6060, 0, 1, 3), 0);
}

TEST(SdoServer, ChecksHeartbeatConsumers) {
  Cia402Config config = two_node_drivetrain();
  config.setup.push_back({.node = 1, .object = {0x1016, 2, 4, false}, .meaning = ""});
  DriveRig rig = booted(config);
  EXPECT_EQ(rig.write(1, 0x1016, 1, 4, 0x0080'00FA), kInvalidValue) << "no node 128";
  EXPECT_EQ(rig.write(1, 0x1016, 1, 4, 0x007F'00FA), 0);
  EXPECT_EQ(rig.write(1, 0x1016, 2, 4, 0x007F'0064), 0x06040043) << "one producer, one consumer";
  EXPECT_EQ(rig.write(1, 0x1016, 2, 4, 0x0010'0064), 0);
}

TEST(SdoServer, SendsStringsInSegments) {
  DriveRig rig = booted();
  rig.forget_sent();
  rig.send(0x601, {0x40, 0x08, 0x10, 0, 0, 0, 0, 0});
  ASSERT_EQ(rig.sent().back().frame.data[0], 0x41);
  const std::size_t size = rig.sent().back().frame.data[4];
  std::string text;
  for (std::uint8_t toggle = 0x60; text.size() < size; toggle ^= 0x10) {
    rig.send(0x601, {toggle, 0, 0, 0, 0, 0, 0, 0});
    const CanFrame& f = rig.sent().back().frame;
    ASSERT_EQ(f.data[0] & 0xF0, toggle & 0x10);
    const std::size_t count = 7u - (f.data[0] >> 1 & 7);
    text.append(f.data.begin() + 1, f.data.begin() + 1 + static_cast<std::ptrdiff_t>(count));
    EXPECT_EQ((f.data[0] & 1) != 0, text.size() == size);
  }
  EXPECT_EQ(text, "Tether emulated drive");
}

TEST(SdoServer, ARepeatedToggleBitEndsTheTransfer) {
  DriveRig rig = booted();
  rig.send(0x601, {0x40, 0x08, 0x10, 0, 0, 0, 0, 0});
  rig.send(0x601, {0x60, 0, 0, 0, 0, 0, 0, 0});
  rig.send(0x601, {0x60, 0, 0, 0, 0, 0, 0, 0});
  const CanFrame& f = rig.sent().back().frame;
  EXPECT_EQ(f.data[0], 0x80);
  EXPECT_EQ(f.data[7] << 24 | f.data[6] << 16 | f.data[5] << 8 | f.data[4], kToggle);
}

TEST(SdoServer, KnowsNoBlockTransfer) {
  DriveRig rig = booted();
  rig.send(0x601, {0xA4, 0x08, 0x10, 0, 0x10, 0, 0, 0});
  const CanFrame& f = rig.sent().back().frame;
  EXPECT_EQ(f.data[7] << 24 | f.data[6] << 16 | f.data[5] << 8 | f.data[4], kUnknownCommand);
}

TEST(SdoServer, LeavesShortRequestsAndAbortsUnanswered) {
  DriveRig rig = booted();
  rig.forget_sent();
  rig.send(0x601, {0x40, 0x00, 0x10, 0});
  rig.send(0x601, {0x80, 0x00, 0x10, 0, 0, 0, 0x02, 0x06});
  EXPECT_TRUE(rig.sent().empty());
}

TEST(SdoServer, RefusesOneObjectOrAllOnInjectionAndNoneAfterIt) {
  DriveRig rig = booted();
  rig.drives().inject({1, DriveFault::Kind::sdo_abort, 0x1016}, rig.now());
  EXPECT_EQ(rig.write(1, 0x1016, 1, 4, 0x007F'00FA), kNoObject);
  EXPECT_EQ(rig.abort_of_read(1, 0x1016, 1), kNoObject);
  EXPECT_EQ(rig.read(1, 0x1000, 0), 0x00020192);
  EXPECT_EQ(rig.write(2, 0x1016, 1, 4, 0x007F'00FA), 0) << "the other node is whole";
  rig.drives().inject({0, DriveFault::Kind::sdo_abort, 0}, rig.now());
  EXPECT_EQ(rig.abort_of_read(1, 0x1000, 0), kNoObject);
  EXPECT_EQ(rig.abort_of_read(2, 0x1000, 0), kNoObject);
  rig.drives().inject({0, DriveFault::Kind::none, 0}, rig.now());
  EXPECT_EQ(rig.write(1, 0x1016, 1, 4, 0x007F'00FA), 0);
}

}  // namespace
}  // namespace tether
