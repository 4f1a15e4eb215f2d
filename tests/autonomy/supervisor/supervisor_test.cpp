#include "onboard/autonomy/supervisor.hpp"

#include <gtest/gtest.h>

namespace tether {
namespace {

constexpr Duration kStep = std::chrono::milliseconds{20};

/// Free way, localised, on the path, standing.
Supervisor::Sight good() {
  Supervisor::Sight sight;
  sight.localised = sight.way_free = sight.on_path = sight.stands = true;
  return sight;
}

Supervisor::Sight blocked() {
  Supervisor::Sight sight = good();
  sight.blocked = true;
  sight.way_free = false;
  return sight;
}

class SupervisorTest : public ::testing::Test {
 protected:
  /// Time passes with this sight.
  void pass(double seconds, const Supervisor::Sight& sight) {
    const Instant end = now_ + from_seconds(seconds);
    while (now_ < end) {
      now_ += kStep;
      supervisor_.step(now_, sight);
    }
  }
  /// A blocked vehicle asks; asked_ is when.
  void ask() {
    pass(0.1, good());
    pass(settings_.wait_s + 0.1, blocked());
    ASSERT_EQ(supervisor_.state(), DriveState::remote_requested);
    asked_ = now_;
  }
  RemoteFate say(bool is_stop, std::optional<Instant> report, bool followed = true) {
    return hear(now_, seq_++, is_stop, report, followed);
  }
  RemoteFate hear(Instant stamp, std::int64_t seq, bool is_stop, std::optional<Instant> report,
                  bool followed = true) {
    return supervisor_.hear(now_, stamp, seq, is_stop, report, [followed] { return followed; });
  }

  AutonomySettings settings_;
  Supervisor supervisor_{settings_};
  Instant now_ = kStart;
  Instant asked_{};
  std::int64_t seq_ = 0;
};

TEST_F(SupervisorTest, DrivesByItselfAtFirst) {
  EXPECT_EQ(supervisor_.state(), DriveState::autonomous);
  EXPECT_EQ(supervisor_.driver(now_), Driver::law);
  EXPECT_EQ(supervisor_.handover(), 0);
}

TEST_F(SupervisorTest, SomethingInItsFieldStopsIt) {
  pass(0.1, good());
  pass(0.02, blocked());
  EXPECT_EQ(supervisor_.state(), DriveState::protective_stop);
  EXPECT_EQ(supervisor_.reason(), "something is in the stopping field");
  EXPECT_EQ(supervisor_.driver(now_), Driver::none);
}

TEST_F(SupervisorTest, ItGoesOnByItselfWhenTheWayHasBeenFreeForAWhile) {
  pass(0.02, blocked());
  pass(1.0, good());
  EXPECT_EQ(supervisor_.state(), DriveState::protective_stop);
  pass(0.04, good());
  EXPECT_EQ(supervisor_.state(), DriveState::autonomous);
}

TEST_F(SupervisorTest, AWayThatIsFreeNowAndThenIsNotFree) {
  pass(0.02, blocked());
  for (int i = 0; i < 4; ++i) {
    pass(0.6, good());
    pass(0.04, blocked());
  }
  EXPECT_EQ(supervisor_.state(), DriveState::protective_stop);
}

TEST_F(SupervisorTest, ItDoesNotGoOnBeforeItHasComeToRest) {
  pass(0.02, blocked());
  Supervisor::Sight rolling = good();
  rolling.stands = false;
  pass(5.0, rolling);
  EXPECT_EQ(supervisor_.state(), DriveState::protective_stop);
}

TEST_F(SupervisorTest, BlockedForLongItAsksForARemoteDriver) {
  ask();
  EXPECT_EQ(supervisor_.handover(), 1);
  EXPECT_EQ(supervisor_.driver(now_), Driver::none);
}

TEST_F(SupervisorTest, WithoutAPoseItStopsAndAsks) {
  Supervisor::Sight lost = good();
  lost.localised = lost.on_path = false;
  pass(0.02, lost);
  EXPECT_EQ(supervisor_.state(), DriveState::protective_stop);
  EXPECT_EQ(supervisor_.reason(), "localisation is lost");
  pass(settings_.wait_s + 0.1, lost);
  EXPECT_EQ(supervisor_.state(), DriveState::remote_requested);
}

TEST_F(SupervisorTest, WithoutAScanItStops) {
  Supervisor::Sight blind = good();
  blind.unfit = "no scan";
  pass(0.02, blind);
  EXPECT_EQ(supervisor_.state(), DriveState::protective_stop);
  EXPECT_EQ(supervisor_.reason(), "no scan");
}

TEST_F(SupervisorTest, NoRemoteDriverDrivesAVehicleThatDoesNotAsk) {
  pass(0.1, good());
  EXPECT_EQ(say(false, now_), RemoteFate::unasked);
  EXPECT_EQ(say(true, now_), RemoteFate::unasked);
  EXPECT_EQ(supervisor_.driver(now_), Driver::law);
}

TEST_F(SupervisorTest, AStopThatNamesTheRequestTakesTheVehicleOver) {
  ask();
  EXPECT_EQ(say(true, asked_), RemoteFate::accepted);
  EXPECT_EQ(supervisor_.state(), DriveState::remote);
  EXPECT_EQ(supervisor_.driver(now_), Driver::remote);
  EXPECT_EQ(say(false, asked_), RemoteFate::accepted);
  EXPECT_EQ(supervisor_.handover(), 1);
}

TEST_F(SupervisorTest, TheFirstWordOfADriverIsToStandStill) {
  ask();
  EXPECT_EQ(say(false, asked_), RemoteFate::not_from_rest);
  EXPECT_EQ(supervisor_.state(), DriveState::remote_requested);
}

TEST_F(SupervisorTest, CommandsOfBeforeTheRequestDoNotCount) {
  ask();
  EXPECT_EQ(say(true, asked_ - std::chrono::seconds{1}), RemoteFate::other_handover);
  EXPECT_EQ(say(true, std::nullopt), RemoteFate::other_handover);
  EXPECT_EQ(supervisor_.state(), DriveState::remote_requested);
}

TEST_F(SupervisorTest, AReportThatWasNotMadeYetIsNamedByNoHonestDriver) {
  ask();
  EXPECT_EQ(say(true, now_ + std::chrono::milliseconds{1}), RemoteFate::from_future);
}

TEST_F(SupervisorTest, WhoSeesThePastIsNoDriver) {
  ask();
  const Instant seen = now_;
  pass(1.02, blocked());
  EXPECT_EQ(say(true, seen), RemoteFate::old);
}

TEST_F(SupervisorTest, DuplicatesAndOldNumbersChangeNothing) {
  ask();
  EXPECT_EQ(hear(now_, 5, true, now_), RemoteFate::accepted);
  EXPECT_EQ(hear(now_, 5, true, now_), RemoteFate::out_of_order);
  EXPECT_EQ(hear(now_ - kStep, 4, false, now_), RemoteFate::out_of_order);
}

TEST_F(SupervisorTest, WhatTheVehicleDoesNotFollowNeitherTakesItOverNorRefreshes) {
  ask();
  EXPECT_EQ(say(true, now_, false), RemoteFate::not_followed);
  EXPECT_EQ(supervisor_.state(), DriveState::remote_requested);
  say(true, now_);
  for (int i = 0; i < 5; ++i) {
    pass(0.1, blocked());
    EXPECT_EQ(say(false, now_, false), RemoteFate::not_followed);
  }
  EXPECT_EQ(supervisor_.driver(now_), Driver::none);
}

TEST_F(SupervisorTest, OfTwoSendersNoneDrives) {
  ask();
  say(true, now_);
  Supervisor::Sight two = blocked();
  two.several_senders = true;
  pass(0.02, two);
  EXPECT_EQ(supervisor_.driver(now_), Driver::none);
  EXPECT_EQ(say(false, now_), RemoteFate::several);
}

TEST_F(SupervisorTest, ASilentDriverIsNoDriver) {
  ask();
  say(true, now_);
  pass(0.48, blocked());
  EXPECT_EQ(supervisor_.driver(now_), Driver::remote);
  pass(0.02, blocked());
  EXPECT_EQ(supervisor_.driver(now_), Driver::none);
  EXPECT_EQ(supervisor_.state(), DriveState::remote);
  say(false, now_);
  EXPECT_EQ(supervisor_.driver(now_), Driver::remote);
}

TEST_F(SupervisorTest, AfterALongSilenceItAsksAgainAndOldCommandsDoNotCount) {
  ask();
  say(true, now_);
  const Instant before = now_;
  pass(settings_.remote_timeout_s + settings_.wait_s + 0.1, blocked());
  EXPECT_EQ(supervisor_.state(), DriveState::remote_requested);
  EXPECT_EQ(supervisor_.handover(), 2);
  EXPECT_EQ(say(false, before), RemoteFate::other_handover);
}

TEST_F(SupervisorTest, OnAFreePathItTakesTheVehicleBackFromStandstill) {
  ask();
  say(true, now_);
  Supervisor::Sight sight = good();
  sight.stands = false;
  for (int i = 0; i < 6; ++i) {
    say(false, now_);
    pass(0.2, sight);
  }
  EXPECT_EQ(supervisor_.state(), DriveState::returning);
  EXPECT_EQ(supervisor_.handover(), 2);
  EXPECT_EQ(supervisor_.driver(now_), Driver::none);
  EXPECT_EQ(say(false, now_), RemoteFate::unasked);
  pass(0.02, good());
  EXPECT_EQ(supervisor_.state(), DriveState::autonomous);
}

TEST_F(SupervisorTest, BesideThePathItDoesNotTakeTheVehicleBack) {
  ask();
  Supervisor::Sight sight = good();
  sight.on_path = false;
  for (int i = 0; i < 10; ++i) {
    say(true, now_);
    pass(0.2, sight);
  }
  EXPECT_EQ(supervisor_.state(), DriveState::remote);
}

TEST_F(SupervisorTest, IfTheWayCloseAgainWhileItReturnsItStands) {
  ask();
  say(true, now_);
  Supervisor::Sight sight = good();
  sight.stands = false;
  for (int i = 0; i < 6; ++i) {
    say(false, now_);
    pass(0.2, sight);
  }
  ASSERT_EQ(supervisor_.state(), DriveState::returning);
  pass(0.02, blocked());
  EXPECT_EQ(supervisor_.state(), DriveState::protective_stop);
}

TEST_F(SupervisorTest, WhenTheWayIsFreeBeforeAnybodyCameItGoesOn) {
  ask();
  pass(1.1, good());
  EXPECT_EQ(supervisor_.state(), DriveState::autonomous);
  EXPECT_EQ(supervisor_.handover(), 2);
}

TEST_F(SupervisorTest, EachCommandIsCountedOnce) {
  ask();
  say(true, now_);
  say(false, asked_ - std::chrono::seconds{2});
  say(false, now_);
  CounterList counters;
  supervisor_.list(counters);
  const auto value = [&counters](const std::string& name) {
    for (const auto& [key, number] : counters) {
      if (key == name) return number;
    }
    return std::int64_t{-1};
  };
  EXPECT_EQ(value("remote.accepted"), 2);
  EXPECT_EQ(value("remote.other_handover"), 1);
  EXPECT_EQ(value("remote.requests"), 1);
}

}  // namespace
}  // namespace tether
