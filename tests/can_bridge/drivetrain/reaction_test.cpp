#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <string>

#include "can_bridge/profiles/profiles.hpp"
#include "common/base/errors.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"

// A watchdog that notices a lost bridge has to say what it does then.
namespace tether {
namespace {

using ::testing::HasSubstr;

std::string shipped_text() {
  std::ifstream in(in_source("/drivetrains/two_node_cia402.toml"));
  return {std::istreambuf_iterator<char>(in), {}};
}

/// The shipped file with its one `from` replaced.
std::string with(const std::string& from, const std::string& to) {
  std::string text = shipped_text();
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  EXPECT_EQ(text.find(from, at + 1), std::string::npos) << "more than one " << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

Cia402Config parse(const std::string& toml) {
  return std::get<Cia402Config>(parse_drivetrain(toml, "test.toml"));
}

std::string reaction_refusal(const std::string& toml) {
  return refusal_of([&] { parse_drivetrain(toml, "test.toml"); });
}

const std::string kReaction = "\nreaction = \"0x6007:00 i16\"\nreaction_value = 3 ";

TEST(WatchdogReaction, IsWrittenByStartUp) {
  for (const WatchdogConfig& w : parse(shipped_text()).watchdogs) {
    EXPECT_EQ(w.reaction, (ObjectRef{0x6007, 0, 2, true}));
    EXPECT_EQ(w.reaction_value, 3);
  }
}

TEST(WatchdogReaction, OfAHeartbeatConsumerMustBeSaid) {
  EXPECT_THAT(
      reaction_refusal(with(kReaction, "\n")),
      HasSubstr("watchdog.reaction is missing: must be the object that says what the drive "
                "does without heartbeat, such as \"0x6007:00 i16\", with reaction_value, or "
                "\"fixed\""));
}

TEST(WatchdogReaction, MayBeFixedInTheDrive) {
  const std::string text = with(kReaction, "\nreaction = \"fixed\"\n");
  EXPECT_EQ(reaction_refusal(text), "accepted");
  EXPECT_FALSE(parse(text).watchdogs[0].reaction.has_value());
  EXPECT_THAT(reaction_refusal(with("\nreaction = \"0x6007:00 i16\"", "\nreaction = \"fixed\"")),
              HasSubstr("watchdog.reaction_value needs watchdog.reaction ="));
}

TEST(WatchdogReaction, NeedsAnObjectAndAValue) {
  EXPECT_THAT(
      reaction_refusal(with("\nreaction = \"0x6007:00 i16\"", "\nreaction = \"quick stop\"")),
      HasSubstr("watchdog.reaction = 'quick stop' is not allowed: must be the object"));
  EXPECT_THAT(reaction_refusal(with("\nreaction_value = 3 ", "\n")),
              HasSubstr("watchdog.reaction_value is missing: must be a whole number"));
  EXPECT_THAT(reaction_refusal(with("\nreaction_value = 3 ", "\nreaction_value = 32768 ")),
              HasSubstr("what fits 0x6007:00 i16"));
}

TEST(WatchdogReaction, MustNotBeNone) {
  EXPECT_THAT(reaction_refusal(with("\nreaction_value = 3 ", "\nreaction_value = 0 ")),
              HasSubstr("watchdog.reaction_value = 0 is not allowed: must be a reaction that stops "
                        "the wheels (0x6007: 1 fault, 2 power off, 3 quick stop); 0 is none"));
  EXPECT_THAT(
      reaction_refusal(with(kReaction, "\nreaction = \"0x6807:00 i16\"\nreaction_value = 0 ")),
      HasSubstr("watchdog.reaction_value = 0 is not allowed"));
  // 0 may mean anything in a vendor's object.
  EXPECT_EQ(
      reaction_refusal(with(kReaction, "\nreaction = \"0x2007:00 i16\"\nreaction_value = 0 ")),
      "accepted");
}

TEST(WatchdogReaction, IsNotSetTwice) {
  const std::string again =
      "[[setup]]\nnode = 1\nobject = \"0x6007:00 i16\"\nvalue = 2\nmeaning = \"power off\"\n";
  EXPECT_THAT(reaction_refusal(shipped_text() + again),
              HasSubstr("is written from watchdog.reaction"));
}

TEST(WatchdogReaction, IsNotSwitchedOffBySetup) {
  const std::string fixed = with(kReaction, "\nreaction = \"fixed\"\n");
  const std::string off =
      "[[setup]]\nnode = 1\nobject = \"0x6007:00 i16\"\nvalue = 0\nmeaning = \"no action\"\n";
  EXPECT_THAT(
      reaction_refusal(fixed + off),
      HasSubstr("setup of 0x6007:00 i16 on node 1: value = 0 means that the drive runs on"));
}

}  // namespace
}  // namespace tether
