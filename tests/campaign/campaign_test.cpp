#include "tests/campaign/campaign.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <optional>
#include <string>
#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>

#include "tests/campaign/rules.hpp"

// The campaign itself: it gives the same on any number of threads, and its rules see what breaks
// them. Records here are written manually.

namespace tether::campaign {
namespace {

using State = drivetrain_state_t;
using Request = drive_request_t;

constexpr Duration kCycle = std::chrono::milliseconds{20};
constexpr Instant at_ms(int ms) { return kStart + std::chrono::milliseconds{ms}; }

TEST(FaultCampaign, GivesTheSameOnAnyNumberOfThreads) {
  const auto setup = load_setup();
  const Totals one = run_campaign(setup, {.first_seed = 7, .runs = 24, .threads = 1});
  const Totals three = run_campaign(setup, {.first_seed = 7, .runs = 24, .threads = 3});
  EXPECT_GT(one.driven_m, 1.0);
  EXPECT_EQ(one.fingerprint, three.fingerprint);
  EXPECT_EQ(one.faults, three.faults);
  EXPECT_EQ(one.stops, three.stops);
  const Totals others = run_campaign(setup, {.first_seed = 8, .runs = 24, .threads = 1});
  EXPECT_NE(one.fingerprint, others.fingerprint);
}

/// 4 s of driving straight on at 1 m/s on twists, armed from 1 s to 3 s; the wheels stand 0.5 s
/// after that. It breaks no rule.
Record drive() {
  Record r;
  r.limits = {kCycle,
              std::chrono::milliseconds{200},
              std::chrono::milliseconds{500},
              std::chrono::seconds{1},
              1.0,
              1.2,
              2.0,
              1.0,
              2.0,
              2.0,
              2.0,
              2.0};
  r.quiet = at_ms(3000);
  r.end = at_ms(4000);
  r.requests = {{at_ms(970), Request::ARM, true}, {at_ms(2990), Request::DISARM, true}};
  for (int ms = 0; ms <= 4000; ms += 10) {
    const Instant t = at_ms(ms);
    const double v = ms < 1100 || ms > 3500 ? 0.0 : ms < 3000 ? 1.0 : (3500 - ms) / 500.0;
    r.wheels.push_back({t, {v, v}});
    if (ms % 20 != 0) continue;
    std::int32_t state = State::DISARMED;
    if (ms >= 980 && ms < 1000) state = State::ARMING;
    if (ms >= 1000 && ms < 3000) state = State::ARMED;
    if (ms >= 3000 && ms < 3500) state = State::STOPPING;
    const bool moves = state == State::ARMED && ms > 1020;
    r.states.push_back({t, state, {moves ? 1.0 : 0.0, 0.0}});
    r.setpoints.push_back({t, moves});
    for (auto& heard : r.heard) heard.push_back(t);
    if (ms < 3000) r.commands.push_back({t, false, t, {}, ms < 1010 ? Instant::max() : t});
  }
  return r;
}

void set_states(Record& r, int from_ms, int until_ms, std::int32_t state) {
  for (StateSample& s : r.states) {
    if (s.when >= at_ms(from_ms) && s.when < at_ms(until_ms)) s.state = state;
  }
}

std::string broken(const Record& record) {
  const auto found = check(1, record);
  return found.empty() ? "" : found.front().rule;
}

TEST(FaultCampaign, TheSeedsThatOnceBrokeARuleBreakNone) {
  const auto setup = load_setup();
  for (const std::uint64_t seed :
       {200942U,  203504U,  205111U,  208213U,  221629U,  222974U,  223933U,  230143U,
        282556U,  308297U,  318805U,  345917U,  351009U,  1000781U, 1002912U, 1016389U,
        1099469U, 1148729U, 1156914U, 1160925U, 1161709U, 1194893U, 1213547U, 1242003U,
        1244163U, 1253728U, 1328095U, 1347030U, 1492066U}) {
    for (const Trial& trial : {draw_trial(seed), with_vehicle(draw_trial(seed))}) {
      for (const Finding& f : check(seed, run_trial(setup, trial, false))) {
        ADD_FAILURE() << seed << ": " << f.rule << " at " << to_seconds(f.when) << ": " << f.what;
      }
    }
  }
}

TEST(FaultCampaign, AWheelWithoutWitnessMayBeCutAndOneThatIsOnlyFrozenMayNot) {
  Record frozen = drive();
  frozen.faults = {{FaultKind::encoder_freeze, at_ms(3000), at_ms(3500), 0.0, 1}};
  frozen.cuts = {{at_ms(3100), 0, 0.8, false}};
  EXPECT_EQ(broken(frozen), "power cut while turning");
  Record silent = drive();
  silent.faults = {{FaultKind::drive_silent, at_ms(3000), at_ms(3500), 0.0, 1}};
  silent.cuts = {{at_ms(3100), 0, 0.8, true}};
  EXPECT_EQ(broken(silent), "");
}

TEST(FaultCampaign, AFaultOfADriveThatJustRebootsShowsAsMissingFeedback) {
  for (const int after_ms : {0, 20, 30}) {
    const bool reboots = after_ms <= 20;  // before its next report
    Record r = drive();
    r.faults = {{FaultKind::drive_fault, at_ms(2000), at_ms(2000), 0.0, 1}};
    const Instant reboot = at_ms(2000 + after_ms);
    r.faults.push_back({FaultKind::drive_reboot, reboot, reboot, 0.0, 1});
    set_states(r, 2120, 3000, State::STOPPING);
    EXPECT_EQ(fault_unnoticed(r).has_value(), !reboots);
  }
}

TEST(FaultCampaign, AForeignNmtStartBeginsADrivesDeadlineAgain) {
  Record r = drive();
  r.heard[1].resize(60);  // setpoints until 1.2 s
  EXPECT_TRUE(wheel_turns_without_setpoints(r).has_value());
  for (int ms = 1250; ms < 3500; ms += 50) {
    r.faults.push_back({FaultKind::nmt, at_ms(ms), at_ms(ms), 0.0, 2});
  }
  EXPECT_FALSE(wheel_turns_without_setpoints(r).has_value());
}

TEST(FaultCampaign, ADriveThatRefusesItsStopBySdoHasUntilItsWatchdogActs) {
  for (const bool refuses : {true, false}) {
    Record r = drive();
    r.heard[1].resize(60);  // setpoints until 1.2 s
    set_states(r, 1200, 3000, State::FAULT);
    for (WheelSample& w : r.wheels) {
      if (w.when > at_ms(1900)) w.rim_mps = {};
    }
    r.limits.deceleration_mps2 = r.limits.yaw_deceleration_radps2 = 10.0;
    r.faults = {{FaultKind::nmt, at_ms(1190), at_ms(1190), 0.0, 2}};
    if (refuses) r.faults.push_back({FaultKind::sdo_abort, at_ms(1000), at_ms(2000), 0.0, 2});
    EXPECT_EQ(wheel_turns_without_setpoints(r).has_value(), !refuses);
    EXPECT_EQ(wheels_turn_unarmed(r).has_value(), !refuses);
  }
}

TEST(FaultCampaign, AWheelThatWasPushedMayBeCutWithAFailedEncoderAsLongAsItRolls) {
  for (const bool paused : {false, true}) {
    Record r = drive();
    for (WheelSample& w : r.wheels) w.when = w.when + std::chrono::seconds(10);
    for (int ms = 0; ms <= 10'000; ms += 10) {
      r.wheels.insert(r.wheels.begin() + ms / 10, {at_ms(ms), {1.0, 0.0}, {false, true}});
    }
    if (paused) r.wheels[900].rim_mps = {};
    r.faults = {{FaultKind::pushed, at_ms(100), at_ms(500), 0.0, 1},
                {FaultKind::wheel_slip, at_ms(9500), at_ms(9800), 0.0, 1}};
    r.cuts = {{at_ms(9600), 0, 1.0, true}};
    EXPECT_EQ(power_cut_while_turning(r).has_value(), paused);
  }
}

TEST(FaultCampaign, AnOrdinaryDriveBreaksNoRule) { EXPECT_EQ(broken(drive()), ""); }

struct Case {
  const char* rule;
  void (*spoil)(Record& r);
};
class EachRule : public ::testing::TestWithParam<Case> {};

TEST_P(EachRule, SeesWhatBreaksIt) {
  Record record = drive();
  GetParam().spoil(record);
  for (const Rule& rule : rules()) {
    if (std::string(rule.name) == GetParam().rule) {
      EXPECT_TRUE(rule.broken(record)) << rule.name;
      return;
    }
  }
  ADD_FAILURE() << "no such rule";
}

INSTANTIATE_TEST_SUITE_P(
    FaultCampaign, EachRule,
    ::testing::Values(
        Case{"wheels turn though not armed", [](Record& r) { r.wheels[40].rim_mps[1] = 0.03; }},
        Case{"wheels turn on old commands",
             [](Record& r) { r.commands.resize(60); }},  // none after 1.2 s
        Case{"a wheel turns without setpoints", [](Record& r) { r.heard[1].resize(60); }},
        Case{"blind for too long",
             [](Record& r) {
               for (CommandSample& c : r.commands) {
                 c.plan = true;
                 c.seen = std::min(c.when, at_ms(1500));
               }
             }},
        Case{"blind too far",
             [](Record& r) {
               r.limits.max_blind_m = 0.5;
               for (CommandSample& c : r.commands) {
                 c.plan = true;
                 c.seen = c.when - std::chrono::milliseconds{510};
               }
             }},
        Case{"no rest at the end", [](Record& r) { r.wheels.back().rim_mps[0] = 0.002; }},
        Case{"power cut while turning",
             [](Record& r) {
               r.cuts.push_back({at_ms(3200), 0, 0.6, false});
             }},
        Case{"power cut while turning",
             [](Record& r) {
               r.cuts.push_back({at_ms(3200), 1, -0.06, true});
             }},
        Case{"standstill reported while turning",
             [](Record& r) { set_states(r, 3300, 3500, State::DISARMED); }},
        Case{"standstill reported while turning",
             [](Record& r) { r.wheels[99].rim_mps[1] = r.wheels[100].rim_mps[1] = 0.06; }},
        Case{"armed wheel not as told", [](Record& r) { r.wheels[200].rim_mps[0] = 1.3; }},
        Case{"armed wheel not as told", [](Record& r) { r.wheels[200].rim_mps[0] = -1.0; }},
        Case{"e-stop left",
             [](Record& r) {
               r.requests = {{at_ms(2000), Request::ESTOP, true}};
               set_states(r, 2000, 3000, State::ESTOP);
               r.restarts = {at_ms(3000)};
               set_states(r, 3000, 4001, State::DISARMED);
             }},
        Case{"setpoint forbidden", [](Record& r) { r.states[10].twist.omega_radps = 0.001; }},
        Case{"setpoint forbidden", [](Record& r) { r.states[100].twist.v_mps = 2.1; }},
        Case{"frame forbidden", [](Record& r) { r.setpoints[10].moves = true; }},
        Case{"stop not obeyed",
             [](Record& r) {
               r.requests.push_back({at_ms(2995), Request::ESTOP, true}),
                   set_states(r, 3000, 3020, State::ARMED);
             }},
        Case{"armed without a request", [](Record& r) { r.requests[0].acts = false; }},
        Case{"armed without a request",
             [](Record& r) { set_states(r, 980, 1000, State::DISARMED); }},
        Case{"armed without zero",
             [](Record& r) {
               for (CommandSample& c : r.commands) c.moves_from = c.when;
             }},
        Case{"armed on old commands", [](Record& r) { r.commands.resize(60); }},
        Case{"fault left", [](Record& r) { set_states(r, 3600, 3700, State::FAULT); }},
        Case{"e-stop left",
             [](Record& r) {
               r.requests = {{at_ms(3010), Request::ESTOP, true},
                             {at_ms(3020), Request::RESET, true}};
             }},
        Case{"fault unnoticed",
             [](Record& r) {
               r.faults = {{FaultKind::drive_fault, at_ms(2000), at_ms(2000), 0.0, 1}};
             }},
        Case{"frozen encoder unnoticed", [](Record& r) {
               r.faults = {{FaultKind::encoder_freeze, at_ms(1200), at_ms(3000), 0.0, 1}};
             }}));

}  // namespace
}  // namespace tether::campaign
