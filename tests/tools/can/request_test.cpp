#include <gmock/gmock.h>

#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>

#include "tools/can/operator.hpp"

namespace tether {
namespace {

using State = drivetrain_state_t;
using Request = drive_request_t;
using enum RequestOutcome;

constexpr Duration kSoon = std::chrono::milliseconds{20};
constexpr Duration kJustBefore = kReactionTime - Duration{1};

RequestOutcome judge(std::int32_t request, std::int32_t state, Duration since,
                     const std::string& reason = "") {
  drivetrain_state_t message{};
  message.state = state;
  message.reason = reason;
  return judge_request(request, message, since);
}

TEST(RequestOutcome, ArmIsReachedWhenArmedAndPendingWhileTheDrivesSwitchOn) {
  EXPECT_EQ(judge(Request::ARM, State::ARMED, kSoon), reached);
  EXPECT_EQ(judge(Request::ARM, State::ARMING, kReactionTime * 10), pending);
}

TEST(RequestOutcome, ARefusedArmShowsWhenTheBridgeHadTimeToReact) {
  for (const std::int32_t state :
       std::initializer_list<std::int32_t>{State::STARTING, State::REFUSED, State::DISARMED,
                                           State::STOPPING, State::FAULT, State::ESTOP}) {
    EXPECT_EQ(judge(Request::ARM, state, kJustBefore), pending);
    EXPECT_EQ(judge(Request::ARM, state, kReactionTime), refused);
  }
}

TEST(RequestOutcome, DisarmWaitsForTheEndOfTheRamp) {
  EXPECT_EQ(judge(Request::DISARM, State::STOPPING, kReactionTime * 10), pending);
  EXPECT_EQ(judge(Request::DISARM, State::ARMED, kJustBefore), pending);
  EXPECT_EQ(judge(Request::DISARM, State::ARMED, kReactionTime), refused);
  EXPECT_EQ(judge(Request::DISARM, State::DISARMED, kSoon), reached);
  EXPECT_EQ(judge(Request::DISARM, State::FAULT, kSoon), reached) << "not armed is what it wants";
}

TEST(RequestOutcome, EstopIsReachedWhenLatchedAtStandstill) {
  EXPECT_EQ(judge(Request::ESTOP, State::STOPPING, kReactionTime * 10), pending);
  EXPECT_EQ(judge(Request::ESTOP, State::ESTOP, kSoon), reached);
  EXPECT_EQ(judge(Request::ESTOP, State::ARMED, kReactionTime), refused) << "no listener";
}

TEST(RequestOutcome, ReleaseIsReachedWhenTheReasonIsNoMoreThatItIsPressed) {
  const std::string pressed = "e-stop pressed: release it, then reset";
  EXPECT_EQ(judge(Request::ESTOP_RELEASE, State::ESTOP, kJustBefore, pressed), pending);
  EXPECT_EQ(judge(Request::ESTOP_RELEASE, State::ESTOP, kReactionTime, pressed), refused);
  EXPECT_EQ(judge(Request::ESTOP_RELEASE, State::ESTOP, kSoon, "e-stop released: reset to go on"),
            reached);
  EXPECT_EQ(judge(Request::ESTOP_RELEASE, State::DISARMED, kSoon), reached);
}

TEST(RequestOutcome, ResetMayTakeTheDrivesStartUp) {
  EXPECT_EQ(judge(Request::RESET, State::STARTING, kReactionTime * 10), pending);
  EXPECT_EQ(judge(Request::RESET, State::DISARMED, kSoon), reached);
  for (const std::int32_t state : std::initializer_list<std::int32_t>{
           State::REFUSED, State::ARMED, State::STOPPING, State::FAULT, State::ESTOP}) {
    EXPECT_EQ(judge(Request::RESET, state, kJustBefore), pending);
    EXPECT_EQ(judge(Request::RESET, state, kReactionTime), refused);
  }
}

}  // namespace
}  // namespace tether
