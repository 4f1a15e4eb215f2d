#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>
#include <string>

#include "can_bridge/profiles/profiles.hpp"
#include "common/base/errors.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"

// [[safety_input]] of a drivetrain's file.
namespace tether {
namespace {

using ::testing::HasSubstr;
using Function = SafetyInputConfig::Function;

const std::string kName = "[[safety_input]]\nname = \"field\"\n";
const std::string kStop = kName + "function = \"protective_stop\"\n";
const std::string kCan =
    "kind = \"can\"\nid = 0x3A0\nlength = 2\nbyte = 1\nmask = 0x03\nclear = 0x01\n"
    "timeout_ms = 100\n";
const std::string kGpio = "kind = \"gpio\"\nchip = \"gpiochip0\"\nline = 17\n";

DrivetrainConfig with_input(const std::string& inputs, const std::string& file = "agilex_v2") {
  std::ifstream in(in_source("/drivetrains/") + file + ".toml");
  std::ostringstream text;
  text << in.rdbuf() << "\n" << inputs;
  return parse_drivetrain(text.str(), "test.toml");
}

std::string input_refusal(const std::string& inputs) {
  return refusal_of([&] { with_input(inputs); });
}

TEST(SafetyInputFile, WithoutItThereAreNone) { EXPECT_TRUE(safety_inputs(with_input("")).empty()); }

TEST(SafetyInputFile, FilesOfEveryProfileMayHaveThem) {
  for (const char* const file : {"agilex_v2", "two_node_cia402", "dual_axis_cia402", "zlac8015d"}) {
    EXPECT_EQ(safety_inputs(with_input(kStop + kCan, file)).size(), 1U) << file;
  }
}

TEST(SafetyInputFile, ReadsAFrame) {
  const auto input = safety_inputs(with_input(kStop + kCan + "stop = 0x02\n")).at(0);
  EXPECT_EQ(input.name, "field");
  EXPECT_EQ(input.function, Function::protective_stop);
  EXPECT_EQ(input.reaction, SafetyInputConfig::Reaction::quick_stop);
  EXPECT_FALSE(input.restart_after_s) << "nothing restarts unless the file says so";
  const auto& can = std::get<SafetyInputConfig::Can>(input.wiring);
  EXPECT_EQ(can.id, 0x3A0U);
  EXPECT_EQ(can.length, 2);
  EXPECT_EQ(can.byte, 1);
  EXPECT_EQ(can.mask, 3);
  EXPECT_EQ(can.clear, 1);
  EXPECT_EQ(can.stop, 2);
  EXPECT_EQ(can.timeout_ms, 100);
}

TEST(SafetyInputFile, ReadsALine) {
  const auto input =
      safety_inputs(with_input(kStop + "reaction = \"ramp\"\n" + kGpio + "active_low = true\n"));
  EXPECT_EQ(input.at(0).reaction, SafetyInputConfig::Reaction::ramp);
  const auto& gpio = std::get<SafetyInputConfig::Gpio>(input.at(0).wiring);
  EXPECT_EQ(gpio.chip, "gpiochip0");
  EXPECT_EQ(gpio.line, 17U);
  EXPECT_TRUE(gpio.active_low);
}

TEST(SafetyInputFile, ReadsWhatOnlySomeFunctionsHave) {
  const auto inputs = safety_inputs(with_input(
      kStop + "restart_after_s = 2.0\n" + kGpio +
      "[[safety_input]]\nname = \"warning\"\nfunction = \"speed_limit\"\n"
      "speed_limit_mps = 0.3\n" +
      kCan + "[[safety_input]]\nname = \"chain\"\nfunction = \"estop_status\"\n" + kGpio));
  EXPECT_EQ(inputs.at(0).restart_after_s, 2.0);
  EXPECT_EQ(inputs.at(1).function, Function::speed_limit);
  EXPECT_EQ(inputs.at(1).speed_limit_mps, 0.3);
  EXPECT_EQ(inputs.at(2).function, Function::estop_status);
}

TEST(SafetyInputFile, WhatCannotBeIsRefused) {
  const std::string limit = kName + "function = \"speed_limit\"\n";
  const auto can = [](const char* from, const char* to) {
    std::string text = kStop + kCan;
    return text.replace(text.find(from), std::string(from).size(), to);
  };
  const std::vector<std::pair<std::string, std::string>> cases{
      {"[[safety_input]]\n", "safety_input.name is missing"},
      {"[[safety_input]]\nname = \"a field\"\n", "letters, digits and _"},
      {kName + kCan, "safety_input.function is missing"},
      {kName + "function = \"stop\"\n" + kCan,
       "must be \"protective_stop\", \"speed_limit\" or \"estop_status\""},
      {kStop, "safety_input.kind is missing: must be \"can\" or \"gpio\""},
      {kStop + kCan + kStop + kCan, "a name that no other input has"},
      {kStop + kCan + "colour = 1\n", "unknown key \"safety_input.colour\""},
      {limit + kCan, "safety_input.speed_limit_mps is missing"},
      {limit + "speed_limit_mps = 0\n" + kCan, "a number from 0.01 to 10"},
      {kStop + "speed_limit_mps = 0.3\n" + kCan, "needs function = \"speed_limit\""},
      {limit + "speed_limit_mps = 0.3\nreaction = \"ramp\"\n" + kCan,
       "needs function = \"protective_stop\""},
      {kStop + "restart_after_s = 1.9\n" + kCan, "a number from 2 to 60"},
      {kStop + "restart_after_s = 2\nreaction = \"ramp\"\n" + kCan, "which always ramps"},
      {kStop + kCan + "line = 1\n", "safety_input.line has no effect with kind = \"can\""},
      {kStop + kGpio + "mask = 1\n", "safety_input.mask has no effect with kind = \"gpio\""},
      {kStop + "kind = \"gpio\"\nline = 17\n", "safety_input.chip is missing"},
      {kStop + "kind = \"gpio\"\nchip = \"gpiochip0\"\n", "safety_input.line is missing"},
      {can("id = 0x3A0", "id = 0x800"), "a whole number from 1 to 2047"},
      {can("byte = 1", "byte = 2"), "a whole number from 0 to 1 (within the frame's length)"},
      {can("clear = 0x01", "clear = 0"), "a whole number from 1 to 255"},
      {can("clear = 0x01", "clear = 0x05"), "within the mask"},
      {can("timeout_ms = 100", "timeout_ms = 0"), "a whole number from 20 to 1000"},
      {can("timeout_ms = 100", ""), "safety_input.timeout_ms is missing"},
      {kStop + kCan + "stop = 1\n", "another value than clear"},
      {kStop + kCan + "stop = 4\n", "within the mask"}};
  for (const auto& [text, part] : cases) {
    EXPECT_THAT(input_refusal(text), HasSubstr(part)) << text;
    EXPECT_THAT(input_refusal(text), HasSubstr("test.toml:")) << text;
  }
}

}  // namespace
}  // namespace tether
