#include "can_bridge/commission/record.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "can_bridge/commission/readings.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;

Cia402Config two_nodes() {
  return std::get<Cia402Config>(load_drivetrain(in_source("/drivetrains/two_node_cia402.toml")));
}

CommissionRecord a_record() {
  CommissionRecord record;
  record.vehicle = "AGV";
  record.interface = "can0";
  record.operator_name = "O'Neill \"Op\" \\";
  record.date = "2026-11-27T06:54:19Z";
  record.wheels = "free";
  record.speed_mps = 0.5;
  record.results = {{"left drive (node 1)", "quick stop", "stands", ""}};
  record.settings = {{"left.sign", "1"}};
  record.objects = {{"node 1, 0x1018:4 (serial number)", "0x000003E9"}};
  return record;
}

TEST(CommissionRecordTest, IsReadAsItWasWritten) {
  CommissionRecord record = a_record();
  record.results.push_back({"right drive (node 2)", "nothing sent", "drives on", "it drives on"});
  const CommissionRecord read = parse_record(to_toml(record), "record.toml");
  EXPECT_EQ(to_toml(read), to_toml(record));
  EXPECT_EQ(read.operator_name, record.operator_name);
  EXPECT_EQ(read.results[1].problem, "it drives on");
  EXPECT_EQ(read.settings, record.settings);
  EXPECT_EQ(read.objects, record.objects);
}

TEST(CommissionRecordTest, PassedOnlyWithResultsAndNoProblem) {
  CommissionRecord record = a_record();
  EXPECT_TRUE(record.passed());
  record.results.push_back({"right drive (node 2)", "quick stop", "drives on", "it drives on"});
  EXPECT_FALSE(record.passed());
  record.results.clear();
  EXPECT_FALSE(record.passed());
}

TEST(CommissionRecordTest, OneThatIsCutOffOrOfAnotherFormatIsRefused) {
  const std::string text = to_toml(a_record());
  const auto refusal = [](const std::string& toml) {
    return refusal_of([&] { parse_record(toml, "record.toml"); });
  };
  EXPECT_EQ(refusal(text), "accepted");
  EXPECT_THAT(refusal(text.substr(0, text.find("[[object]]"))), HasSubstr("[[object]]"));
  EXPECT_THAT(refusal(text.substr(0, text.find("[[result]]"))), HasSubstr("[[result]]"));
  EXPECT_THAT(refusal("format = 2\n"), HasSubstr("record.toml:1: format = 2"));
  EXPECT_THAT(refusal(text + "\n[more]\n"), HasSubstr("more"));
  EXPECT_THAT(refusal(""), HasSubstr("record.toml"));
}

TEST(CommissionRecordTest, ANameThatIsThereTwiceIsRefused) {
  CommissionRecord record = a_record();
  record.objects.push_back(record.objects[0]);
  EXPECT_THAT(refusal_of([&] { parse_record(to_toml(record), "record.toml"); }),
              HasSubstr("a name that no other entry has"));
}

TEST(CommissionRecordTest, DifferencesNameWhatIsOtherWhatIsNewAndWhatIsGone) {
  EXPECT_EQ(differences({{"a", "1"}, {"b", "2"}}, {{"a", "1"}, {"b", "2"}}), "");
  EXPECT_EQ(differences({{"a", "1"}, {"b", "2"}}, {{"b", "3"}, {"c", "4"}}),
            "b is 3, was 2; c is 4, was not there; a is not there, was 1");
}

TEST(CommissionRecordTest, EverySettingThatDecidesOnCommandsToDrivesIsCompared) {
  const auto before = commissioned_settings(two_nodes(), 0.4);
  const auto difference = [&](auto change) {
    Cia402Config config = two_nodes();
    change(config);
    return differences(before, commissioned_settings(config, 0.4));
  };
  EXPECT_EQ(difference([](Cia402Config&) {}), "");
  EXPECT_EQ(difference([](Cia402Config& c) { c.axes[1].sign = 1; }), "right.sign is 1, was -1");
  EXPECT_EQ(difference([](Cia402Config& c) {
              c.axes[0].counts_per_revolution = {1, 3};
            }),
            "left.counts_per_revolution is 1/3, was 81920");
  EXPECT_THAT(
      difference([](Cia402Config& c) { c.watchdogs[0].reaction_value = 1; }),
      HasSubstr("watchdog of node 1, 0x1016:1, reaction is 1 in 0x6007:0, was 3 in 0x6007:0"));
  EXPECT_THAT(difference([](Cia402Config& c) { c.watchdogs[0].timeout_ms = 900; }),
              HasSubstr("is 900 ms, was 250 ms"));
  EXPECT_THAT(difference([](Cia402Config& c) { c.setup.back().value = 192; }),
              HasSubstr("setup of node 2, 0x6085:0 (quick stop deceleration) is 192, was 19200"));
  EXPECT_THAT(difference([](Cia402Config& c) { c.pdos[0].event_timer_ms = 0; }),
              HasSubstr("event timer 0 ms"));
  EXPECT_EQ(differences(before, commissioned_settings(two_nodes(), 0.2)),
            "vehicle.wheel_radius_m is 0.2, was 0.4");
}

TEST(RecordedObjectsTest, AreOfEachNodeAndEachOnce) {
  const std::vector<RecordedObject> all = recorded_objects(two_nodes());
  const auto count = [&](std::uint8_t node, std::uint16_t index) {
    return std::ranges::count_if(
        all, [&](const RecordedObject& o) { return o.node == node && o.index == index; });
  };
  for (const std::uint8_t node : {1, 2}) {
    EXPECT_EQ(count(node, 0x1018), 4);
    for (const std::uint16_t index : {0x100A, 0x1016, 0x6007, 0x605A, 0x6083, 0x6085, 0x607E}) {
      EXPECT_EQ(count(node, index), 1) << std::hex << index;
    }
  }
}

}  // namespace
}  // namespace tether
