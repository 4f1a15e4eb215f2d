#include <fmt/format.h>
#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "can_bridge/profiles/profiles.hpp"
#include "common/base/errors.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

/// A drivetrain that is in order, section by section.
struct Toml {
  std::string head = "name = \"test\"\nprofile = \"cia402\"\n";
  std::string bridge = "[bridge]\nheartbeat_ms = 60\n";
  std::string drives = "[drives]\nfeedback_timeout_ms = 100\n";
  std::string left =
      "[left]\nnode = 1\nsign = 1\ntarget_velocity_per_rps = 60\nactual_velocity_per_rps = 600\n"
      "counts_per_revolution = [8192, 3]\n";
  std::string right =
      "[right]\nnode = 2\nsign = -1\ntarget_velocity_per_rps = 60\nactual_velocity_per_rps = 60\n"
      "counts_per_revolution = 4096\n";
  std::string setup =
      "[[setup]]\nnode = [1, 2]\nobject = \"0x605A:00 i16\"\nvalue = 2\nmeaning = \"quick stop\"\n";
  std::string watchdog =
      "[[watchdog]]\nnode = [1, 2]\nkind = \"heartbeat_consumer\"\ntimeout_ms = 250\n"
      "reaction = \"0x6007:00 i16\"\nreaction_value = 3\n";
  std::string rpdo =
      "[[pdo]]\nnode = [1, 2]\nrpdo = 1\ntransmission = 1\n"
      "objects = [\"controlword\", \"target_velocity\"]\n";
  std::string tpdo1 =
      "[[pdo]]\nnode = [1, 2]\ntpdo = 1\ntransmission = 1\n"
      "objects = [\"statusword\", \"actual_velocity\"]\n";
  std::string tpdo2 =
      "[[pdo]]\nnode = [1, 2]\ntpdo = 2\ntransmission = 1\nobjects = [\"actual_position\"]\n";
  std::string ramp =
      "[[setup]]\nnode = [1, 2]\nobject = \"0x6085:00 u32\"\nvalue = 100\nmeaning = \"ramp\"\n";

  std::string text() const {
    return head + bridge + drives + left + right + setup + watchdog + rpdo + tpdo1 + tpdo2 + ramp;
  }
};

Cia402Config parse(const Toml& toml) {
  return std::get<Cia402Config>(parse_drivetrain(toml.text(), "test.toml"));
}

std::string refusal(const std::string& toml) {
  return refusal_of([&] { parse_drivetrain(toml, "test.toml"); });
}

/// `text` with its one `from` replaced.
std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  EXPECT_EQ(text.find(from, at + 1), std::string::npos) << "more than one " << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

// ---------------------------------------------------------------------------- reading

TEST(DrivetrainFile, WhatIsNotGivenStaysAtItsDefault) {
  const Cia402Config c = parse({});
  const Cia402Config defaults;
  EXPECT_EQ(c.sdo_timeout_ms, defaults.sdo_timeout_ms);
  EXPECT_EQ(c.drive_heartbeat_timeout_ms, defaults.drive_heartbeat_timeout_ms);
  EXPECT_EQ(c.axes[0].error_code, defaults.axes[0].error_code);
}

TEST(DrivetrainFile, NamesTheEmergencyMessagesThatAreWarnings) {
  const Cia402Config c = parse({.drives = "[drives]\nemcy_warnings = [0x8110, 0x4210]\n"});
  EXPECT_TRUE(c.is_warning(0x8110));
  EXPECT_TRUE(c.is_warning(0x4210));
  EXPECT_FALSE(c.is_warning(0x8120));
}

TEST(DrivetrainFile, RatiosAreWholeNumbersOrFractions) {
  const Cia402Config c = parse({});
  EXPECT_EQ(c.axes[0].counts_per_revolution.num, 8192);
  EXPECT_EQ(c.axes[0].counts_per_revolution.den, 3);
  EXPECT_EQ(c.axes[0].actual_velocity_per_rps.num, 600);
  EXPECT_EQ(c.axes[0].actual_velocity_per_rps.den, 1);
}

TEST(DrivetrainFile, SetupKeepsItsOrderNodeByNode) {
  Toml toml;
  toml.setup +=
      "[[setup]]\nnode = 2\nobject = \"0x605E:00 i16\"\nvalue = -1\nrequired = false\n"
      "meaning = \"last\"\n";
  const Cia402Config c = parse(toml);
  ASSERT_EQ(c.setup.size(), 5U) << "and the ramp of both";
  EXPECT_EQ(c.setup[0].node, 1);
  EXPECT_EQ(c.setup[1].node, 2);
  EXPECT_TRUE(c.setup[1].required);
  EXPECT_EQ(c.setup[2].value, -1);
  EXPECT_FALSE(c.setup[2].required);
  EXPECT_EQ(c.setup[2].meaning, "last");
}

TEST(DrivetrainFile, ObjectsReadAsTheyAreWritten) {
  for (const char* const text :
       {"0x1000:00 u8", "0xFFFF:FF i32", "0x605A:1F i16", "0x2000:0A u32"}) {
    Toml toml;
    toml.left += fmt::format("error_code = \"{}\"\n", text);
    EXPECT_EQ(to_string(parse(toml).axes[0].error_code), text);
  }
}

TEST(DrivetrainFile, AnUnreadableFileIsNamed) {
  try {
    load_drivetrain("/nonexistent/drives.toml");
    FAIL() << "loaded";
  } catch (const UsageError& error) {
    EXPECT_STREQ(error.what(),
                 "cannot read the drivetrain file \"/nonexistent/drives.toml\": No such file "
                 "or directory");
  }
}

// ---------------------------------------------------------------------------- refusals

struct Bad {
  const char* what;
  std::string Toml::*section;
  const char* from;
  const char* to;
  const char* message;
};

void PrintTo(const Bad& bad, std::ostream* out) { *out << bad.what; }

class BadDrivetrain : public ::testing::TestWithParam<Bad> {};

TEST_P(BadDrivetrain, IsRefusedWithFileLineAndWhatIsAllowed) {
  const Bad& bad = GetParam();
  Toml toml;
  toml.*bad.section = replaced(toml.*bad.section, bad.from, bad.to);
  EXPECT_EQ(refusal(toml.text()), bad.message);
}

constexpr const char* kObject =
    "must be an object such as \"0x60FF:00 i32\" (index from 0x1000, subindex, type: i8, u8, i16, "
    "u16, i32 or u32)";

const Bad kReading[] = {
    {"NoName", &Toml::head, "name = \"test\"\n", "",
     "test.toml:1: name is missing: must be a text in quotes (for people)"},
    {"NoProfile", &Toml::head, "profile = \"cia402\"\n", "",
     "test.toml:1: profile is missing: must be \"cia402\" or \"agilex_v2\""},
    {"OtherProfile", &Toml::head, "cia402", "vesc",
     "test.toml:2: profile = 'vesc' is not allowed: must be \"cia402\" or \"agilex_v2\""},
    {"UnknownSection", &Toml::bridge, "[bridge]", "[brigde]",
     "test.toml:3: unknown key \"brigde\": allowed are name, profile, safety_input, bridge, "
     "drives, chassis, "
     "left, right, setup, watchdog, pdo, emulation"},
    {"UnknownKey", &Toml::bridge, "heartbeat_ms", "heartbeat",
     "test.toml:4: unknown key \"bridge.heartbeat\": allowed are node, heartbeat_ms, sync"},
    {"WrongType", &Toml::bridge, "60", "60.0",
     "test.toml:4: bridge.heartbeat_ms = 60.0 is not allowed: must be a whole number from 10 to "
     "1000 (period of the bridge's heartbeat)"},
    {"NotAFlag", &Toml::bridge, "heartbeat_ms = 60", "sync = 1",
     "test.toml:4: bridge.sync = 1 is not allowed: must be true or false (send SYNC in every "
     "control cycle)"},
    {"NotANumber", &Toml::drives, "feedback_timeout_ms = 100", "standstill_radps = nan",
     "test.toml:6: drives.standstill_radps = nan is not allowed: must be a number from 0.0001 to 1 "
     "(wheels slower than this stand)"},
    {"ForTheOtherProfile", &Toml::drives, "[drives]", "[chassis]\ntrack_m = 1.0\n[drives]",
     "test.toml:5: [chassis] has no effect with profile = \"cia402\""},
    {"NoSuchSide", &Toml::left, "[left]", "[drives.left]",
     "test.toml:7: unknown key \"drives.left\": allowed are heartbeat_ms, heartbeat_timeout_ms, "
     "feedback_timeout_ms, boot_timeout_ms, sdo_timeout_ms, sdo_retries, step_timeout_ms, "
     "standstill_radps, emcy_warnings, stop"},
    {"NoErrorAsWarning", &Toml::drives, "feedback_timeout_ms = 100", "emcy_warnings = [0x8110, 0]",
     "test.toml:6: drives.emcy_warnings = [0x8110, 0] is not allowed: must be a whole number "
     "from "
     "1 to 65535 (codes of emergency messages that are no fault), or several in [ ]"},
    {"NodeOutOfRange", &Toml::left, "node = 1", "node = 127",
     "test.toml:8: left.node = 127 is not allowed: must be a whole number from 1 to 126 (CANopen "
     "node id)"},
    {"NoSign", &Toml::left, "sign = 1\n", "", "test.toml:7: left.sign is missing: must be 1 or -1"},
    {"OtherSign", &Toml::left, "sign = 1", "sign = 2",
     "test.toml:9: left.sign = 2 is not allowed: must be 1 or -1 (does a positive speed of the "
     "drive roll forward?)"},
    {"NoScale", &Toml::left, "target_velocity_per_rps = 60\n", "",
     "test.toml:7: left.target_velocity_per_rps is missing: must be a whole number >= 1, or "
     "[numerator, denominator], of the drive's units"},
    {"ZeroDenominator", &Toml::left, "[8192, 3]", "[8192, 0]",
     "test.toml:12: left.counts_per_revolution = [8192, 0] is not allowed: must be a whole "
     "number >= 1, or [numerator, denominator], of the drive's units"},
    {"FloatingScale", &Toml::left, "[8192, 3]", "2730.5",
     "test.toml:12: left.counts_per_revolution = 2730.5 is not allowed: must be a whole number "
     ">= 1, or [numerator, denominator], of the drive's units"},
    {"ListInOneBracket", &Toml::watchdog, "[[watchdog]]", "[watchdog]",
     "test.toml:24: watchdog is a list: write [[watchdog]], with two brackets"},
    {"NoMeaning", &Toml::setup, "meaning = \"quick stop\"\n", "",
     "test.toml:19: setup.meaning is missing: must be a text in quotes (what the value does)"},
    {"ValueDoesNotFit", &Toml::setup, "value = 2", "value = 32768",
     "test.toml:22: setup.value = 32768 is not allowed: must be a whole number from -32768 to "
     "32767 (what fits 0x605A:00 i16)"},
    {"NoNodes", &Toml::setup, "node = [1, 2]", "node = []",
     "test.toml:20: setup.node = [] is not allowed: must be a whole number from 1 to 126 (CANopen "
     "node id), or several in [ ]"},
    {"WatchdogOfNothing", &Toml::watchdog, "timeout_ms = 250", "timeout_ms = 0",
     "test.toml:27: watchdog.timeout_ms = 0 is not allowed: must be a whole number from 30 to 1000 "
     "(silence of the bridge that stops the drive; 0 would be no watchdog)"},
    {"WatchdogOfAnotherKind", &Toml::watchdog, "heartbeat_consumer", "none",
     "test.toml:26: watchdog.kind = 'none' is not allowed: must be \"heartbeat_consumer\" or "
     "\"milliseconds\""},
    {"NeitherRpdoNorTpdo", &Toml::rpdo, "rpdo = 1\n", "",
     "test.toml:30: pdo needs either rpdo = 1…4 (bridge to drive) or tpdo = 1…4 (drive to bridge)"},
    {"FifthPdo", &Toml::rpdo, "rpdo = 1", "rpdo = 5",
     "test.toml:32: pdo.rpdo = 5 is not allowed: must be a whole number from 1 to 4 (number of the "
     "PDO)"},
    {"ReservedTransmission", &Toml::rpdo, "transmission = 1", "transmission = 241",
     "test.toml:33: pdo.transmission = 241 is not allowed: must be 1 to 240 (at every n-th SYNC), "
     "254 or 255 (at once)"},
    {"MisspeltObject", &Toml::rpdo, "\"controlword\"", "\"contrlword\"",
     "test.toml:34: pdo.objects = 'contrlword' is not allowed: must be the name of an axis' "
     "object, such as \"left.controlword\", or an object such as \"0x60FF:00 i32\" (index from "
     "0x1000, subindex, type: i8, u8, i16, u16, i32 or u32)"},
    {"ObjectOfAnotherNode", &Toml::rpdo, "\"controlword\"", "\"left.controlword\"",
     "test.toml:34: pdo.objects = 'left.controlword' is not allowed: must be an object of the "
     "axis on node 2 (left.node = 1, right.node = 2)"},
    {"AxesThatTheRestDoesNotKnow", &Toml::left, "node = 1", "node = 6",
     "test.toml:20: setup.node = [1, 2] is not allowed: must be of axes, and none has node 1: "
     "left.node = 6, right.node = 2; change it there or here (tether can probe --scan lists the "
     "nodes of a bus)"},
    {"PdoOfAnUnknownSender", &Toml::tpdo1, "[1, 2]", "[1, 3]",
     "test.toml:36: pdo.node = [1, 3] is not allowed: must be of axes, and none has node 3: "
     "left.node = 1, right.node = 2; change it there or here (tether can probe --scan lists the "
     "nodes of a bus)"},
    {"NotToml", &Toml::head, "name = \"test\"", "name = test",
     "test.toml:1: Error while parsing boolean: expected 'true', saw 'te'"},
};
INSTANTIATE_TEST_SUITE_P(Reading, BadDrivetrain, ::testing::ValuesIn(kReading),
                         [](const auto& info) { return std::string(info.param.what); });

const Bad kMeaning[] = {
    {"TooLongPdo", &Toml::tpdo1, "\"actual_velocity\"", "\"actual_velocity\", \"actual_position\"",
     "test.toml:35: TPDO1 of node 1 has 10 bytes of objects: a CAN frame carries at most 8"},
    {"SamePdoTwice", &Toml::tpdo2, "tpdo = 2", "tpdo = 1",
     "test.toml:40: TPDO1 of node 1 is described twice, first in line 35"},
    {"NoControlword", &Toml::rpdo, "\"controlword\", ", "",
     "test.toml:7: no RPDO of node 1 carries left.controlword (0x6040:00 u16)"},
    {"NoSetpoint", &Toml::rpdo, ", \"target_velocity\"", "",
     "test.toml:7: no RPDO of node 1 carries left.target_velocity (0x60FF:00 i32)"},
    {"NoStatusword", &Toml::tpdo1, "\"statusword\", ", "",
     "test.toml:7: no TPDO of node 1 carries left.statusword (0x6041:00 u16)"},
    {"NoSpeed", &Toml::tpdo1, ", \"actual_velocity\"", "",
     "test.toml:7: no TPDO of node 1 carries left.actual_velocity (0x606C:00 i32)"},
    {"NoPosition", &Toml::tpdo2, "actual_position", "error_code",
     "test.toml:7: no TPDO of node 1 carries left.actual_position (0x6064:00 i32)"},
    {"PdosOfOneNodeOnly", &Toml::tpdo2, "[1, 2]", "1",
     "test.toml:13: no TPDO of node 2 carries right.actual_position (0x6064:00 i32)"},
    {"SetpointOfAnotherSize", &Toml::rpdo, "\"target_velocity\"", "\"0x60FF:00 i16\"",
     "test.toml:30: RPDO1 of node 1 carries 0x60FF:00 i16, for which the bridge has no value: "
     "RPDOs may carry controlword and target_velocity of an axis of their node"},
    {"UnguardedNode", &Toml::watchdog, "[1, 2]", "1",
     "test.toml:13: node 2 (right axis) has no [[watchdog]]: nothing would stop its wheel when the "
     "bridge or the cable dies"},
    {"WatchdogThatTripsByItself", &Toml::watchdog, "250", "179",
     "test.toml:24: watchdog.timeout_ms = 179 is not allowed: must be at least 180, three times "
     "bridge.heartbeat_ms, or one lost frame stops the drive"},
    {"WatchdogTwice", &Toml::watchdog, "[1, 2]", "[1, 2, 2]",
     "test.toml:24: watchdog 0x1016:01 u32 of node 2 is there twice, first in line 24"},
    {"HeartbeatTimeoutTooShort", &Toml::drives, "feedback_timeout_ms = 100",
     "heartbeat_timeout_ms = 299",
     "test.toml:5: drives.heartbeat_timeout_ms = 299 is not allowed: must be at least 300, three "
     "times drives.heartbeat_ms, or one lost frame stops the vehicle"},
    {"LostBridgeAsWarning", &Toml::drives, "feedback_timeout_ms = 100", "emcy_warnings = 0x8130",
     "test.toml:5: drives.emcy_warnings has 0x8130 (heartbeat of the bridge lost): a drive that "
     "says so stops by itself, which is no warning"},
    {"LostSetpointsAsWarning", &Toml::drives, "feedback_timeout_ms = 100", "emcy_warnings = 0x8250",
     "test.toml:5: drives.emcy_warnings has 0x8250 (setpoints stopped coming): a drive that says "
     "so stops by itself, which is no warning"},
    {"WithoutSync", &Toml::bridge, "heartbeat_ms = 60", "sync = false",
     "test.toml:30: RPDO1 of node 1 has transmission = 1, but bridge.sync = false: the bridge "
     "sends no "
     "SYNC (use 254 or 255)"},
    {"SilentWhenNothingChanges", &Toml::tpdo1, "transmission = 1", "transmission = 255",
     "test.toml:35: TPDO1 of node 1 is sent only when something changes, and silence would look "
     "like a dead drive: give event_timer_ms, or transmission = 1"},
    {"TooRareFeedback", &Toml::tpdo1, "transmission = 1", "transmission = 255\nevent_timer_ms = 51",
     "test.toml:35: TPDO1 of node 1 has event_timer_ms = 51: must be at most 50, half of "
     "drives.feedback_timeout_ms, or one lost frame stops the vehicle"},
    {"DeadlineWithoutTime", &Toml::rpdo, "transmission = 1", "event_timer_required = true",
     "test.toml:30: RPDO1 of node 1 has event_timer_required without event_timer_ms"},
    {"BridgeWithADrivesId", &Toml::bridge, "heartbeat_ms = 60", "node = 2",
     "test.toml:13: right.node = 2 is the bridge's own (bridge.node): each participant needs a "
     "node id of its own"},
    {"SetupTwice", &Toml::setup, "[1, 2]", "[1, 1]",
     "test.toml:19: setup of 0x605A:00 i16 on node 1: is there twice, first in line 19"},
    {"SetupOfAPdo", &Toml::setup, "0x605A:00 i16", "0x1800:05 u16",
     "test.toml:19: setup of 0x1800:05 u16 on node 1: PDO parameters are described in [[pdo]]"},
    {"SetupOfTheWatchdog", &Toml::setup, "0x605A:00 i16", "0x1016:01 u32",
     "test.toml:19: setup of 0x1016:01 u32 on node 1: is written from [[watchdog]]"},
    {"SetupOfTheControlword", &Toml::setup, "0x605A:00 i16", "0x6040:00 u16",
     "test.toml:19: setup of 0x6040:00 u16 on node 1: the bridge itself writes it while it runs"},
    {"UpperHalfOfAHalf", &Toml::left, "sign = 1", "sign = 1\nstatusword_shift = 16",
     "test.toml:7: left.statusword_shift = 16 is not allowed: 0x6041:00 u16 has no 16 bits from "
     "there"},
};
INSTANTIATE_TEST_SUITE_P(Meaning, BadDrivetrain, ::testing::ValuesIn(kMeaning),
                         [](const auto& info) { return std::string(info.param.what); });

TEST(DrivetrainFile, EveryMalformedObjectIsRefused) {
  for (const char* const object :
       {"6040:00 u16", "0x6040 u16", "0x6040:00", "0x6040:00u16", "0x6040:00 u24", "0x6040:00 f32",
        "0x6040:100 u16", "0x16040:00 u16", "0x0FFF:00 u16", "0x60G0:00 u16", "0x6040: u16",
        "0x:00 u16", "0x6040:00 ", "", " 0x6040:00 u16", "0x6040:00 u16 ", "0x6040:-1 u16"}) {
    Toml toml;
    toml.setup = replaced(toml.setup, "0x605A:00 i16", object);
    EXPECT_EQ(refusal(toml.text()),
              fmt::format("test.toml:21: setup.object = '{}' is not allowed: {}", object, kObject));
  }
}

TEST(DrivetrainFile, EmulatedWheelsMayCoast) {
  Toml toml;
  EXPECT_TRUE(parse(toml).emulated_brake);
  toml.tpdo2 += "[emulation]\nbrake = false\n";
  EXPECT_FALSE(parse(toml).emulated_brake);
}

/// Both axes on node 1, the right one's objects as given.
std::string one_node(const std::string& right_objects) {
  Toml toml;
  toml.right = replaced(toml.right, "node = 2", "node = 1") + right_objects;
  toml.setup.clear();
  toml.ramp.clear();
  toml.drives = "[drives]\nstop = \"setpoint\"\n";
  toml.watchdog = replaced(toml.watchdog, "[1, 2]", "1");
  toml.rpdo = toml.tpdo1 = toml.tpdo2 = "";
  toml.rpdo =
      "[[pdo]]\nnode = 1\nrpdo = 1\ntransmission = 1\nobjects = [\"left.controlword\", "
      "\"left.target_velocity\"]\n[[pdo]]\nnode = 1\nrpdo = 2\ntransmission = 1\nobjects = "
      "[\"right.controlword\", \"right.target_velocity\"]\n";
  toml.tpdo1 =
      "[[pdo]]\nnode = 1\ntpdo = 1\ntransmission = 1\nobjects = [\"left.statusword\", "
      "\"right.statusword\"]\n[[pdo]]\nnode = 1\ntpdo = 2\ntransmission = 1\nobjects = "
      "[\"left.actual_velocity\", \"right.actual_velocity\"]\n";
  toml.tpdo2 =
      "[[pdo]]\nnode = 1\ntpdo = 3\ntransmission = 1\nobjects = [\"left.actual_position\", "
      "\"right.actual_position\"]\n";
  return toml.text();
}

TEST(TwoAxesOfOneNode, MayShareTheirControlwordAndTheHalvesOfAStatusword) {
  EXPECT_EQ(refusal(one_node("object_offset = 0x800\n")), "accepted");
  EXPECT_EQ(refusal(one_node("object_offset = 0x800\ncontrolword = \"0x6040:00 u16\"\n")),
            "accepted");
}

TEST(TwoAxesOfOneNode, MustBeToldApartByEverythingElse) {
  const auto message = [](const char* name, const char* object) {
    return fmt::format(
        "test.toml:13: left and right are both on node 1 and have the same {}, {}: axes of one "
        "node "
        "may share only controlword, mode, mode_display, error_code and the halves of a statusword",
        name, object);
  };
  const std::string offset = "object_offset = 0x800\n";
  EXPECT_EQ(refusal(one_node("")), message("target_velocity", "0x60FF:00 i32"));
  EXPECT_EQ(refusal(one_node(offset + "actual_velocity = \"0x606C:00 i32\"\n")),
            message("actual_velocity", "0x606C:00 i32"));
  EXPECT_EQ(refusal(one_node(offset + "actual_position = \"0x6064:00 i32\"\n")),
            message("actual_position", "0x6064:00 i32"));
  EXPECT_EQ(refusal(one_node(offset + "statusword = \"0x6041:00 u16\"\n")),
            message("statusword", "0x6041:00 u16"));
}

TEST(TwoAxesOfOneNode, NeedASideBeforeTheNameOfAnObject) {
  EXPECT_EQ(refusal(replaced(one_node("object_offset = 0x800\n"), "\"left.controlword\"",
                             "\"controlword\"")),
            "test.toml:30: pdo.objects = 'controlword' is not allowed: must be "
            "\"left.controlword\" or \"right.controlword\": both axes are on node 1");
}

TEST(AgilexFile, NeedsTheChassisFigures) {
  const std::string head = "name = \"a\"\nprofile = \"agilex_v2\"\n";
  EXPECT_EQ(refusal(head + "[chassis]\nwheel_radius_m = 0.1\ntrack_m = 0.4\n"), "accepted");
  EXPECT_EQ(refusal(head),
            "test.toml:1: chassis is missing: must be a section [chassis] with wheel_radius_m and "
            "track_m");
  EXPECT_EQ(refusal(head + "[chassis]\nwheel_radius_m = 0.1\n"),
            "test.toml:3: chassis.track_m is missing: must be a number from 0.05 to 10");
  EXPECT_EQ(refusal(head + "[chassis]\nwheel_radius_m = 0\ntrack_m = 0.4\n"),
            "test.toml:4: chassis.wheel_radius_m = 0 is not allowed: must be a number from 0.01 to "
            "2 (of the driven wheels)");
}

TEST(AgilexFile, HasNoCanopenSections) {
  const std::string good =
      "name = \"a\"\nprofile = \"agilex_v2\"\n[chassis]\nwheel_radius_m = 0.1\ntrack_m = 0.4\n";
  EXPECT_EQ(refusal(good + "[left]\nnode = 1\n"),
            "test.toml:6: [left] has no effect with profile = \"agilex_v2\"");
  EXPECT_EQ(refusal(good + "[drives]\nsdo_retries = 1\n"),
            "test.toml:7: unknown key \"drives.sdo_retries\": allowed are feedback_timeout_ms, "
            "boot_timeout_ms, step_timeout_ms, standstill_radps");
}

}  // namespace
}  // namespace tether
