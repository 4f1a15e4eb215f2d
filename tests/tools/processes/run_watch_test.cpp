#include <gmock/gmock.h>

#include "tools/nodes/live_session.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Pair;

constexpr Duration kPeriod = milliseconds{250};

struct RunWatchTest : ::testing::Test {
  static constexpr std::int64_t kRun = 1000;
  RunWatch watch{kRun, "here", 1.0};
  Instant now = kStart;

  static presence_t presence(const std::string& program, std::int64_t pid) {
    presence_t p{};
    p.run = kRun;
    p.program = program;
    p.vehicle = "AGV";
    p.host = "here";
    p.pid = pid;
    return p;
  }
  void hear(const std::string& program, std::int64_t pid) {
    watch.heard(now, presence(program, pid));
  }
  void pass(Duration time, Duration step = kPeriod) {
    for (const Instant end = now + time; now < end;) {
      now = std::min(end, now + step);
      watch.update(now);
    }
  }
};

TEST_F(RunWatchTest, OneOfEachAllAliveIsInOrder) {
  watch.started(now, "tether-sim", 1);
  watch.started(now, "tether-controller", 2);
  pass(RunWatch::kPatience - nanoseconds{1});  // while they start
  for (int i = 0; i < 100; ++i) {
    hear("tether-sim", 1), hear("tether-controller", 2);
    pass(kPeriod);
  }
  EXPECT_THAT(watch.findings(), IsEmpty());
  EXPECT_THAT(watch.hung(now), IsEmpty());
}

TEST_F(RunWatchTest, AProgramIsHungWhenItHasNotBeenHeardForOneAndAHalfSeconds) {
  watch.started(now, "tether-sim", 1);
  hear("tether-sim", 1);
  pass(RunWatch::kSilence - nanoseconds{1});
  EXPECT_THAT(watch.hung(now), IsEmpty());
  pass(nanoseconds{1});
  EXPECT_THAT(watch.hung(now), ElementsAre(Pair("tether-sim", RunWatch::kSilence)));
  EXPECT_FALSE(watch.hangs("tether-sim", now, RunWatch::kPatience));
  pass(RunWatch::kPatience - RunWatch::kSilence);
  EXPECT_TRUE(watch.hangs("tether-sim", now, RunWatch::kPatience));
  EXPECT_THAT(watch.findings(),
              ElementsAre("t = 1.5 s: tether-sim does not answer: stopped, hung or cut off"));
}

TEST_F(RunWatchTest, OneThatIsNeverHeardIsHungFiveSecondsAfterItsStartOrTheRuns) {
  now = kStart - std::chrono::seconds{2};
  watch.started(now, "tether-sim", 1);
  pass(std::chrono::seconds{7} - nanoseconds{1});
  EXPECT_THAT(watch.findings(), IsEmpty());
  pass(nanoseconds{1});
  EXPECT_THAT(watch.findings(),
              ElementsAre("t = 5.0 s: tether-sim does not answer: stopped, hung or cut off"));
  pass(RunWatch::kPatience - RunWatch::kSilence);
  EXPECT_TRUE(watch.hangs("tether-sim", now, RunWatch::kPatience));
  watch.started(now, "tether-sim", 2);
  pass(RunWatch::kPatience - nanoseconds{1});
  EXPECT_THAT(watch.hung(now), IsEmpty());
  pass(nanoseconds{1});
  EXPECT_EQ(watch.hung(now).size(), 1U);
}

TEST_F(RunWatchTest, OneThatAnswersAgainIsNotHungButTheRunWasDisturbed) {
  watch.started(now, "tether-sim", 1);
  hear("tether-sim", 1);
  pass(std::chrono::seconds{3});
  hear("tether-sim", 1);
  pass(kPeriod);
  EXPECT_THAT(watch.hung(now), IsEmpty());
  EXPECT_EQ(watch.findings().size(), 1U);
}

TEST_F(RunWatchTest, OneThatHasEndedOrIsStartedAgainIsNotHung) {
  watch.started(now, "tether-sim", 1);
  hear("tether-sim", 1);
  watch.ended("tether-sim");
  pass(std::chrono::seconds{3});
  watch.started(now, "tether-sim", 2);
  pass(std::chrono::seconds{3});
  hear("tether-sim", 1);  // late
  hear("tether-sim", 2);
  pass(kPeriod);
  EXPECT_THAT(watch.findings(), IsEmpty());
}

TEST_F(RunWatchTest, NoProgramCountsAsSilentWhileTheWatchItselfWasSuspended) {
  watch.started(now, "tether-sim", 1);
  pass(kPeriod);
  hear("tether-sim", 1);
  pass(std::chrono::seconds{60}, std::chrono::seconds{60});
  EXPECT_THAT(watch.hung(now), IsEmpty());
  pass(RunWatch::kSilence);
  EXPECT_EQ(watch.hung(now).size(), 1U) << "but since then";
}

TEST_F(RunWatchTest, InSlowMotionTheLimitsAreOnTheWallClock) {
  watch = RunWatch(kRun, "here", 0.1);
  watch.started(now, "tether-sim", 1);
  hear("tether-sim", 1);
  pass(milliseconds{149}, milliseconds{25});
  EXPECT_THAT(watch.hung(now), IsEmpty());
  pass(milliseconds{1});
  EXPECT_THAT(watch.hung(now), ElementsAre(Pair("tether-sim", RunWatch::kSilence)));
}

TEST_F(RunWatchTest, ASecondOfAProgramIsNamedOnce) {
  watch.started(now, "tether-controller", 2);
  hear("tether-controller", 3);
  hear("tether-controller", 3);
  presence_t elsewhere = presence("tether-controller", 2);
  elsewhere.host = "there\033[2J";
  watch.heard(now, elsewhere);
  EXPECT_THAT(
      watch.findings(),
      ElementsAre("t = 0.0 s: a second tether-controller of AGV, process 3 on host here",
                  "t = 0.0 s: a second tether-controller of AGV, process 2 on host there\\x1b[2J"));
}

TEST_F(RunWatchTest, AProgramThatThisRunDoesNotStartMayBeAnybodys) {
  watch.started(now, "tether-sim", 1);
  hear("tether-controller", 7);  // controller.external
  EXPECT_THAT(watch.findings(), IsEmpty());
}

TEST_F(RunWatchTest, AnotherRunIsNamed) {
  presence_t other = presence("tether live", 9);
  other.run = 2000;
  watch.heard(now, other);
  other.program = "tether-sim";
  watch.heard(now, other);
  EXPECT_THAT(watch.findings(),
              ElementsAre("t = 0.0 s: another run is on this network: tether live of AGV, process "
                          "9 on host here"));
}

TEST_F(RunWatchTest, SeveralSendersAreReportedUnlessAReportedUnknownSenderExplainsThem) {
  watch.started(now, "tether-sim", 1);
  watch.several_senders(now, "several programs send at the same time on AGV/POSE: …");
  hear("tether-sim", 2);
  watch.several_senders(now, "several programs send at the same time on SIM/CLOCK: …");
  EXPECT_THAT(watch.findings(),
              ElementsAre("t = 0.0 s: several programs send at the same time on AGV/POSE: …",
                          "t = 0.0 s: a second tether-sim of AGV, process 2 on host here"));
}

constexpr std::uint64_t kFirst = 0x0100007F'0000'1000, kSecond = 0x0100007F'0000'2000;

TEST_F(RunWatchTest, OneDatagramOfAnUnknownSenderIsAFinding) {
  watch.started(now, "tether-sim", 1);
  watch.sent(now, "AGV/POSE", kFirst);  // before its first presence
  watch.heard(now, presence("tether-sim", 1), kFirst);
  watch.sent(now, "CTRL/POSE", kSecond);
  for (int i = 0; i < 10; ++i) {
    watch.heard(now, presence("tether-sim", 1), kFirst);
    watch.sent(now, "AGV/POSE", kFirst);
    watch.sent(now, "AGV/POSE", 0);  // the network does not say whose
    EXPECT_EQ(watch.findings().size(), now - kStart >= RunWatch::kSilence ? 1U : 0U);
    pass(kPeriod);
  }
  ASSERT_EQ(watch.findings().size(), 1U);
  EXPECT_THAT(watch.findings()[0],
              ::testing::StartsWith("t = 1.5 s: an unknown program sent on CTRL/POSE: "));
}

TEST_F(RunWatchTest, APresenceByTheNameOfAnotherProgramDoesNotMakeASenderKnown) {
  watch.started(now, "tether-sim", 1);
  watch.heard(now, presence("tether-sim", 1), kFirst);
  watch.heard(now, presence("my-tool", 2), kSecond);
  watch.sent(now, "AGV/CMD_VEL", kSecond);
  watch.end(now);
  ASSERT_EQ(watch.findings().size(), 1U);
  EXPECT_THAT(watch.findings()[0], ::testing::HasSubstr("an unknown program sent on AGV/CMD_VEL"));
}

TEST_F(RunWatchTest, TwoPortsOfOneProcessAreAFindingAndAnotherAddressIsNone) {
  watch.started(now, "tether-sim", 1);
  watch.heard(now, presence("tether-sim", 1), kFirst);
  watch.heard(now, presence("tether-sim", 1), kFirst + (1U << 20U));
  EXPECT_THAT(watch.findings(), IsEmpty());
  watch.heard(now, presence("tether-sim", 1), kSecond);
  ASSERT_EQ(watch.findings().size(), 1U);
  EXPECT_THAT(
      watch.findings()[0],
      ::testing::EndsWith("says that it is tether-sim of AGV, process 1 on host here, which "
                          "sends from another port"));
}

TEST_F(RunWatchTest, AProgramOfAnotherHostIsASecondOneWhateverItSaysAndWhateverItsPort) {
  watch.started(now, "tether-sim", 1);
  watch.heard(now, presence("tether-sim", 1), kFirst);
  watch.heard(now, presence("tether-sim", 1), kFirst + (1U << 20U), false);
  EXPECT_THAT(watch.findings(),
              ElementsAre("t = 0.0 s: a second tether-sim of AGV, process 1 on host here"));
}

TEST_F(RunWatchTest, TheNameOfAProcessThatHasEndedIsNoPlaceForAnotherSender) {
  watch.started(now, "tether-sim", 1);
  watch.heard(now, presence("tether-sim", 1), kFirst);
  watch.started(now, "tether-sim", 2);
  watch.heard(now, presence("tether-sim", 1), kFirst);  // late
  watch.heard(now, presence("tether-sim", 2), kFirst + 1);
  EXPECT_THAT(watch.findings(), IsEmpty());
  watch.heard(now, presence("tether-sim", 1), kSecond);
  EXPECT_THAT(watch.findings(),
              ElementsAre("t = 0.0 s: a second tether-sim of AGV, process 1 on host here"));
}

TEST_F(RunWatchTest, LateLoopsAreAFindingBeyondFiveMillisecondsInSum) {
  const Duration run = std::chrono::seconds{10};
  EXPECT_EQ(watch.lateness(run), "");
  watch.late("tether-sim", 20'000);  // 2 ms for 10 s
  watch.late("tether-netem", 30'000);
  EXPECT_EQ(watch.lateness(run), "");
  watch.late("tether-netem", 30'100);
  EXPECT_THAT(
      watch.lateness(run),
      ::testing::HasSubstr("5.0 ms older on average, tether-netem alone 3.0 ms; at most 5"));
}

TEST_F(RunWatchTest, TheLatenessOfAProgramThatWasRestartedAddsUp) {
  const Duration run = std::chrono::seconds{10};
  watch.late("tether-sim", 40'000);
  watch.late("tether-sim", 100);  // restarted
  watch.late("tether-sim", 20'000);
  EXPECT_THAT(watch.lateness(run), ::testing::HasSubstr("6.0 ms older"));
}

TEST_F(RunWatchTest, AnUnknownSenderOfTheLastMomentIsFoundAtTheEnd) {
  watch.sent(now, "AGV/CMD_VEL", kFirst);
  pass(kPeriod);
  EXPECT_THAT(watch.findings(), IsEmpty());
  watch.end(now);
  EXPECT_EQ(watch.findings().size(), 1U);
}

TEST_F(RunWatchTest, ASecondSenderOnAnExternalControllersChannelIsFoundAtOnceAndOnce) {
  for (int i = 0; i < 3; ++i) {
    watch.sent_by_controller(now, "CTRL/CMD_VEL", kFirst);
    watch.sent_by_controller(now, "CTRL/REPORT", kSecond);
    watch.sent_by_controller(now, "CTRL/CMD_VEL", 0);  // where the network does not tell
  }
  EXPECT_THAT(watch.findings(), IsEmpty());
  for (int i = 0; i < 3; ++i) watch.sent_by_controller(now, "CTRL/CMD_VEL", kSecond);
  EXPECT_THAT(
      watch.findings(),
      ElementsAre(::testing::HasSubstr(" sent on CTRL/CMD_VEL, which belongs to one external")));
}

TEST_F(RunWatchTest, AFloodOfFindingsIsBounded) {
  watch.started(now, "tether-sim", 1);
  for (int pid = 2; pid < 1000; ++pid) hear("tether-sim", pid);
  EXPECT_EQ(watch.findings().size(), 20U);
}

}  // namespace
}  // namespace tether
