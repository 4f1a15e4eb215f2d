#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <string>

#include "can_bridge/cia402/stop_objects.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "common/base/input_file.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"

// Settings of a drivetrain file for the drives' own stop.

namespace tether {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;

std::string shipped(const char* name) {
  return read_input(in_source("/drivetrains/") + name, "the drivetrain file", kMostTomlBytes);
}

/// The text with the [[setup]] entries of this object taken out.
std::string without(std::string text, const std::string& object) {
  for (auto at = text.find("\"" + object); at != std::string::npos; at = text.find("\"" + object)) {
    const auto from = text.rfind("[[setup]]", at);
    const auto until = text.find("\n\n", at);
    text.erase(from, until - from);
  }
  return text;
}

std::string file_refusal(const std::string& text) {
  return refusal_of([&] { parse_drivetrain(text, "test.toml"); });
}

TEST(StopObjects, AFileWithoutQuickStopOptionOrRampIsRefused) {
  const std::string text = shipped("two_node_cia402.toml");
  EXPECT_EQ(file_refusal(text), "accepted");
  EXPECT_THAT(file_refusal(without(text, "0x605A:00")),
              HasSubstr("no [[setup]] sets its quick stop option"));
  EXPECT_THAT(file_refusal(without(text, "0x6085:00")),
              HasSubstr("the ramp of its quick stop (0x6085)"));
  EXPECT_THAT(file_refusal(without(shipped("dual_axis_cia402.toml"), "0x6885:00")),
              HasSubstr("right axis"));
}

TEST(StopObjects, AFileThatSaysThatStopsAreBySetpointNeedsNeither) {
  std::string text = without(without(shipped("two_node_cia402.toml"), "0x605A:00"), "0x6085:00");
  text.replace(text.find("[drives]\n"), 9, "[drives]\nstop = \"setpoint\"\n");
  EXPECT_EQ(file_refusal(text), "accepted");
  text.replace(text.find("\"setpoint\""), 10, "\"coasting\"");
  EXPECT_THAT(file_refusal(text), HasSubstr("\"quick_stop\" or \"setpoint\""));
}

TEST(StopObjects, AQuickStopOptionThatDoesNotBrakeIsRefused) {
  for (const std::string option : {"0", "3", "7"}) {
    std::string text = shipped("two_node_cia402.toml");
    const auto at = text.find("value = 2", text.find("\"0x605A:00"));
    text.replace(at, 9, "value = " + option);
    EXPECT_THAT(file_refusal(text), HasSubstr("does not brake by a ramp")) << option;
  }
}

TEST(StopObjects, ARampBelowTheBridgesDecelerationIsRefused) {
  std::string text = shipped("two_node_cia402.toml");
  const auto at = text.find("value = 19200", text.find("\"0x6085:00"));
  text.replace(at, 13, "value = 192");
  const DrivetrainConfig typo = parse_drivetrain(text, "test.toml");
  EXPECT_EQ(refusal_of([&] { check_deceleration(typo, 1.5, 0.4); }),
            "drivetrain \"two CiA 402 drives, profile velocity\": the left axis stops with 0.04 "
            "m/s2, less than can.max_deceleration_mps2 = 1.5: set its ramp (0x6085 or 0x6084) to "
            "7162 at least");
  const DrivetrainConfig good = parse_drivetrain(shipped("two_node_cia402.toml"), "test.toml");
  EXPECT_EQ(refusal_of([&] { check_deceleration(good, 4.0, 0.4); }), "accepted");
  EXPECT_NE(refusal_of([&] { check_deceleration(good, 4.1, 0.4); }), "accepted");
}

TEST(StopObjects, TheRampIsTheOneThatTheOptionCodeNames) {
  auto config =
      std::get<Cia402Config>(parse_drivetrain(shipped("two_node_cia402.toml"), "test.toml"));
  EXPECT_NEAR(cia402::stop_ramp_radps2(config, 0) * 0.4, 4.02, 0.01);
  for (SetupWrite& setup : config.setup) {
    if (setup.object.index == 0x605A) setup.value = 5;
    if (setup.object.index == 0x6084) setup.value = 9600;
  }
  EXPECT_NEAR(cia402::stop_ramp_radps2(config, 1) * 0.4, 2.01, 0.01);
}

TEST(StopObjects, TheWeakerAxisTellsHowTheDrivesStop) {
  const DrivetrainConfig shipped_drives =
      parse_drivetrain(shipped("two_node_cia402.toml"), "test.toml");
  ASSERT_TRUE(own_stop(shipped_drives, 0.4).mps2);
  EXPECT_NEAR(*own_stop(shipped_drives, 0.4).mps2, 4.02, 0.01);
  EXPECT_NEAR(*own_stop(shipped_drives, 0.2).mps2, 2.01, 0.01);
  for (const std::uint8_t weaker : {1, 2}) {
    auto config = std::get<Cia402Config>(shipped_drives);
    for (SetupWrite& setup : config.setup) {
      if (setup.object.index == 0x6085 && setup.node == weaker) setup.value = 9600;
    }
    EXPECT_NEAR(config.own_stop(0.4).mps2.value_or(0.0), 2.01, 0.01) << int{weaker};
    std::erase_if(config.setup, [&](const SetupWrite& setup) {
      return setup.object.index == 0x6085 && setup.node == weaker;
    });
    EXPECT_FALSE(config.own_stop(0.4).mps2) << int{weaker};
  }
  EXPECT_FALSE(own_stop(parse_drivetrain(shipped("agilex_v2.toml"), "test.toml"), 0.4).mps2);
}

TEST(StopObjects, TheDeadlineIsThatOfSetpointsIfRequiredElseTheWatchdogsAndOfTheLaterWheel) {
  const auto deadline = [](const char* file) {
    return own_stop(parse_drivetrain(shipped(file), "test.toml"), 0.4).deadline;
  };
  EXPECT_EQ(deadline("two_node_cia402.toml"), milliseconds{250});
  EXPECT_EQ(deadline("agilex_v2.toml"), milliseconds{500});
  auto config = std::get<Cia402Config>(parse_drivetrain(shipped("two_node_cia402.toml"), "t.toml"));
  const auto require = [&](std::uint8_t node) {
    for (PdoConfig& pdo : config.pdos) {
      if (!pdo.transmit && pdo.node == node) pdo.event_timer_required = true;
    }
  };
  require(1);
  EXPECT_EQ(config.own_stop(0.4).deadline, milliseconds{250}) << "node 2 has its watchdog only";
  require(2);
  EXPECT_EQ(config.own_stop(0.4).deadline, milliseconds{100});
}

TEST(StopObjects, AreKnownOfBothAxes) {
  using cia402::StopPart;
  for (const std::uint16_t index :
       {0x6085, 0x605A, 0x605B, 0x605C, 0x605D, 0x605E, 0x6885, 0x685A}) {
    EXPECT_EQ(cia402::stop_part(index), StopPart::quick_stop) << index;
  }
  for (const std::uint16_t index :
       {0x6007, 0x1016, 0x6084, 0x607E, 0x608F, 0x6090, 0x6091, 0x6092, 0x6096, 0x6884}) {
    EXPECT_EQ(cia402::stop_part(index), StopPart::other) << index;
  }
  for (const std::uint16_t index : {0x1400, 0x1603, 0x1800, 0x1A00}) {
    EXPECT_EQ(cia402::stop_part(index), StopPart::pdo) << index;
  }
  for (const std::uint16_t index :
       {0x1000, 0x1018, 0x2000, 0x6059, 0x605F, 0x6093, 0x60FF, 0x6041}) {
    EXPECT_EQ(cia402::stop_part(index), StopPart::none) << index;
  }
}

}  // namespace
}  // namespace tether
