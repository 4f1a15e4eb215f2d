#include "tools/can/drive_import.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <regex>

#include "can_bridge/profiles/profiles.hpp"
#include "common/base/errors.hpp"

namespace tether {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

/// A section of CiA 306-1's form.
std::string variable(const std::string& section, int data_type, const std::string& more = "") {
  return "[" + section + "]\r\nParameterName=Object " + section +
         "\r\nObjectType=0x7\r\nDataType=0x000" + std::to_string(data_type) +
         "\r\nAccessType=rw\r\nPDOMapping=1\r\n" + more + "\r\n";
}

/// The text with this section in the place of the one of its name.
std::string with(std::string text, const std::string& section) {
  const std::size_t begin = text.find(section.substr(0, section.find(']') + 1));
  const std::size_t end = std::min(text.find("\n[", begin), text.size() - 1) + 1;
  return text.replace(begin, end - begin, section);
}

/// The objects of one axis, "60" or "68".
std::string axis(const std::string& base) {
  return variable(base + "3F", 6) + variable(base + "40", 6) + variable(base + "41", 6) +
         variable(base + "5A", 3) + variable(base + "60", 2) + variable(base + "61", 2) +
         variable(base + "64", 4) + variable(base + "6C", 4) + variable(base + "83", 7) +
         variable(base + "84", 7) + variable(base + "85", 7, "DefaultValue=5000\r\n") +
         variable(base + "FF", 4);
}

std::string pdos(int count) {
  std::string text;
  for (int i = 0; i < count; ++i) {
    for (const char* const base : {"140", "180"}) {
      const std::string index = base + std::to_string(i);
      text += variable(index + "sub1", 7, "DefaultValue=$NODEID+0x180\r\n") +
              variable(index + "sub5", 6);
    }
    for (const char* const base : {"160", "1A0"}) {
      text += "[" + (base + std::to_string(i)) +
              "]\r\nObjectType=9\r\nDataType=7\r\nCompactSubObj=8\r\n";
    }
  }
  return text;
}

std::string device() {
  return "; made manually\r\n[FileInfo]\r\nEDSVersion=4.0\r\n\r\n[DeviceInfo]\r\nVendorName=Ex "
         "\"am\" ple\r\nProductName=Servo\r\n"
         "[Comments]\r\nLines=1\r\nLine1=anything [goes] = here\r\n" +
         variable("1016sub1", 7) + variable("1017", 6) + variable("6007", 3);
}

std::string single_axis() { return device() + axis("60") + pdos(2); }

EdsFile read(const std::string& text) { return read_eds(text, "drive.eds"); }
std::string error_of(const std::string& text) {
  try {
    read(text);
  } catch (const UsageError& error) {
    return error.what();
  }
  return "";
}

TEST(Eds, ReadsObjectsTheirTypesAndValuesInAllBases) {
  const EdsFile eds = read(device() + variable("2000", 5, "DefaultValue=0x1F\r\n") +
                           variable("2001sub0A", 4, "DefaultValue=-017\r\nParameterValue=12\r\n") +
                           variable("2002", 9, "DefaultValue=text\r\n"));
  EXPECT_EQ(eds.vendor, "Ex \"am\" ple");
  const auto* const first = eds.find(0x2000);
  ASSERT_NE(first, nullptr);
  EXPECT_EQ(first->ref, (ObjectRef{0x2000, 0, 1, false}));
  EXPECT_EQ(first->default_value, 0x1F);
  EXPECT_EQ(first->value, std::nullopt);
  const auto* const second = eds.find(0x2001, 0x0A);
  ASSERT_NE(second, nullptr);
  EXPECT_EQ(second->ref, (ObjectRef{0x2001, 0x0A, 4, true}));
  EXPECT_EQ(second->default_value, -15);
  EXPECT_EQ(second->value, 12);
  EXPECT_EQ(eds.find(0x2002)->ref.bytes, 0);
  EXPECT_EQ(eds.find(0x2003), nullptr);
}

TEST(Eds, CompactSubobjectsAreAllThere) {
  const EdsFile eds = read(single_axis());
  EXPECT_EQ(eds.find(0x1A01, 0), nullptr);
  EXPECT_EQ(eds.find(0x1A01, 8)->ref, (ObjectRef{0x1A01, 8, 4, false}));
  EXPECT_EQ(eds.find(0x1A01, 9), nullptr);
}

TEST(Eds, AFormulaWithTheNodeIdIsNoValue) {
  EXPECT_EQ(read(single_axis()).find(0x1400, 1)->default_value, std::nullopt);
}

TEST(Eds, ErrorsNameFileAndLine) {
  EXPECT_THAT(error_of("[FileInfo]\nthis is no key\n"),
              AllOf(HasSubstr("drive.eds:2: \"this is no key\""), HasSubstr("KEY=VALUE")));
  EXPECT_THAT(error_of("A=1\n"), HasSubstr("drive.eds:1: "));
  EXPECT_THAT(error_of("[a]\n"), HasSubstr("drive.eds: no section [DeviceInfo]"));
  EXPECT_THAT(error_of("[DeviceInfo]\n[6040]\nDataType=six\n"),
              HasSubstr("drive.eds:3: datatype = \"six\" is not allowed: must be a whole number"));
  EXPECT_THAT(error_of("[DeviceInfo]\n[DeviceComissioning]\nNodeID=128\n"),
              HasSubstr("drive.eds:3: nodeid = 128 is not allowed: must be 1 to 127"));
  EXPECT_THAT(error_of("[DeviceInfo]\n[1003]\nCompactSubObj=300\n"), HasSubstr("drive.eds:3: "));
}

TEST(Eds, BytesThatAreNoTextAreRefusedOrSkippedAndNeverRead) {
  const std::string whole = single_axis();
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const std::string error = error_of(whole.substr(0, size));
    EXPECT_TRUE(error.empty() || error.starts_with("drive.eds")) << error;
  }
  EXPECT_THAT(error_of(std::string("\0\xff\n", 3)), HasSubstr("drive.eds:1: \"\\x00\\xff\""));
}

TEST(DriveSkeleton, NamesWhatADataSheetCannotSayAndNothingElse) {
  const DriveSkeleton skeleton = drive_skeleton(read(single_axis()), "drive.eds", {});
  EXPECT_THAT(
      skeleton.missing,
      ElementsAre(
          HasSubstr("left.sign"), HasSubstr("left.target_velocity_per_rps"),
          HasSubstr("left.actual_velocity_per_rps"), HasSubstr("left.counts_per_revolution"),
          HasSubstr("right.sign"), HasSubstr("right.target_velocity_per_rps"),
          HasSubstr("right.actual_velocity_per_rps"), HasSubstr("right.counts_per_revolution"),
          HasSubstr("value of 0x6083:00 u32"), HasSubstr("value of 0x6084:00 u32"),
          AllOf(HasSubstr("value of 0x6085:00 u32"), HasSubstr("default is 5000"))));
  EXPECT_THAT(skeleton.text, AllOf(HasSubstr("name = \"Ex \\\"am\\\" ple Servo\"\n"),
                                   HasSubstr("[left]\nnode = 1\n"),
                                   HasSubstr("[right]\nnode = 2\n"), Not(HasSubstr("0x1029"))));
  for (const std::string& what : skeleton.missing) {
    EXPECT_THAT(skeleton.text, HasSubstr("# MISSING: " + what + "\n"));
  }
}

TEST(DriveSkeleton, TakesAConfiguredDevicesNodeAndRamps) {
  const std::string dcf = with(single_axis(), variable("6083", 7, "ParameterValue=14400\r\n")) +
                          "[DeviceComissioning]\r\nNodeID=0x10\r\n";
  const DriveSkeleton skeleton = drive_skeleton(read(dcf), "drive.dcf", {});
  EXPECT_THAT(skeleton.text,
              AllOf(HasSubstr("[left]\nnode = 16\n"), HasSubstr("[right]\nnode = 17\n"),
                    HasSubstr("value = 14400\n")));
  EXPECT_THAT(skeleton.missing, Not(Contains(HasSubstr("0x6083"))));
}

TEST(DriveSkeleton, AnObjectThatIsDescribedTwiceIsRefused) {
  EXPECT_THROW(drive_skeleton(read(single_axis() + variable("6083", 7)), "drive.eds", {}),
               UsageError);
}

TEST(DriveSkeleton, ASecondAxisAt0x800IsTheRightWheelOfTheSameNode) {
  const std::string text = device() + axis("60") + axis("68") + pdos(4);
  const DriveSkeleton skeleton = drive_skeleton(read(text), "drive.eds", {});
  EXPECT_THAT(skeleton.text, AllOf(HasSubstr("[right]\nnode = 1\nobject_offset = 0x800\n"),
                                   HasSubstr("\"right.controlword\", \"right.target_velocity\""),
                                   HasSubstr("tpdo = 4"), HasSubstr("0x6885:00 u32")));
  const DriveSkeleton two = drive_skeleton(read(text), "drive.eds", {3, 4});
  EXPECT_THAT(two.text, AllOf(HasSubstr("node = [3, 4]"), Not(HasSubstr("object_offset"))));
}

TEST(DriveSkeleton, TwoWheelsNeedTwoNodesOfOneAxisEach) {
  EXPECT_THROW(drive_skeleton(read(single_axis()), "drive.eds", {5}), UsageError);
  EXPECT_THROW(drive_skeleton(read(single_axis()), "drive.eds", {5, 5}), UsageError);
}

TEST(DriveSkeleton, NamesEachObjectThatTheDeviceLacks) {
  const std::string empty =
      "[DeviceInfo]\nVendorName=X\n" + variable("6502", 7, "DefaultValue=1\n");
  const std::vector<std::string> missing = drive_skeleton(read(empty), "x.eds", {}).missing;
  for (const char* const what :
       {"profile velocity mode", "a heartbeat: ", "left.controlword: the device has no 0x6040",
        "0x6041", "0x6060", "0x6061", "0x60FF", "0x606C", "0x6064", "0x603F", "no 0x605A",
        "no 0x6085", "[[watchdog]]", "rpdo 1: the device has no 0x1400",
        "tpdo 2: the device has no 0x1801"}) {
    EXPECT_THAT(missing, Contains(HasSubstr(what)));
  }
}

TEST(DriveSkeleton, NamesAnObjectThatNoPdoCanCarryAndAReactionThatIsNotThere) {
  std::string text = single_axis();
  const std::string mappable = "PDOMapping=1";
  text.replace(text.find(mappable, text.find("[606C]")), mappable.size(), "PDOMapping=0");
  text.erase(text.find("[6007]"), variable("6007", 3).size());
  EXPECT_THAT(drive_skeleton(read(text), "x.eds", {}).missing,
              AllOf(Contains(HasSubstr("left.actual_velocity: 0x606C cannot be mapped")),
                    Contains(HasSubstr("watchdog.reaction"))));
}

TEST(DriveSkeleton, IsADrivetrainFileOnceItsGapsAreFilled) {
  const std::vector<std::pair<std::string, std::string>> values{
      {"sign", "sign = -1"},
      {"target_velocity_per_rps", "target_velocity_per_rps = 65536"},
      {"actual_velocity_per_rps", "actual_velocity_per_rps = 65536"},
      {"counts_per_revolution", "counts_per_revolution = 4096"},
      {"value of", "value = 400000"}};
  for (const std::string& sheet : {single_axis(), device() + axis("60") + axis("68") + pdos(4)}) {
    std::string text = drive_skeleton(read(sheet), "drive.eds", {}).text;
    EXPECT_THROW(parse_drivetrain(text, "skeleton.toml"), UsageError);
    for (const auto& [what, value] : values) {
      text = std::regex_replace(text, std::regex("# MISSING: [^\n]*" + what + "[^\n]*"), value);
    }
    EXPECT_THAT(text, Not(HasSubstr("MISSING:")));
    EXPECT_NO_THROW(parse_drivetrain(text, "skeleton.toml"));
  }
}

TEST(DriveSkeleton, NamesWhatTheBridgeHasToWriteAndCannot) {
  std::string text = single_axis();
  for (const char* const section : {"[1017]", "[60FF]", "[6085]"}) {
    const std::string access = "AccessType=rw";
    text.replace(text.find(access, text.find(section)), access.size(), "AccessType=RO");
  }
  EXPECT_THAT(drive_skeleton(read(text), "x.eds", {}).missing,
              AllOf(Contains(HasSubstr("a heartbeat: ")),
                    Contains("left.target_velocity: 0x60FF is read-only"),
                    Contains(HasSubstr("0x6085 (quick stop deceleration) is read-only"))));
}

TEST(DriveSkeleton, ListsScalesWithoutTheNumberOfThem) {
  const std::string text = single_axis() + variable("608Fsub0", 5, "DefaultValue=2\r\n") +
                           variable("608Fsub1", 7, "DefaultValue=4096\r\n");
  EXPECT_THAT(drive_skeleton(read(text), "x.eds", {}).text,
              AllOf(HasSubstr("# 0x608F:01 Object 608Fsub1 is 4096\n"), Not(HasSubstr("608F:00"))));
}

TEST(DriveSkeleton, NodesAreBelowTheBridges) {
  const std::string dcf = single_axis() + "[DeviceComissioning]\r\nNodeID=126\r\n";
  EXPECT_THROW(drive_skeleton(read(dcf), "drive.dcf", {}), UsageError);
  EXPECT_NO_THROW(drive_skeleton(read(dcf), "drive.dcf", {125, 126}));
}

TEST(DriveSkeleton, WritesTheDevicesOwnTypes) {
  const std::string text =
      with(with(single_axis(), variable("60FF", 3)), variable("6085", 6, "ParameterValue=300\r\n"));
  const DriveSkeleton skeleton = drive_skeleton(read(text), "x.eds", {});
  EXPECT_THAT(skeleton.text, AllOf(HasSubstr("target_velocity = \"0x60FF:00 i16\"\n"),
                                   HasSubstr("object = \"0x6085:00 u16\"\n")));
}

}  // namespace
}  // namespace tether
