#include "can_bridge/commission/commission.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/emulated/node.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "tests/support/source_dir.hpp"

// Commissioning in virtual time, with emulated drives that turn wheels of their own.
namespace tether {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

struct Commissioning : ::testing::Test {
  Cia402Config config =
      std::get<Cia402Config>(load_drivetrain(in_source("/drivetrains/two_node_cia402.toml")));
  VehicleConfig vehicle;
  Instant now = kStart;
  EmulatedCia402 drives{config, kStart};
  WheelStates wheels;
  std::optional<Commission> commission;
  std::vector<CanFrame> last;     ///< frames of the newest cycle that sent setpoints
  bool echoes = false;            ///< the drives get setpoints, SYNC and heartbeat whatever is sent
  bool takes_quick_stops = true;  ///< else a drive that gets a quick stop drives on
  double follows = 0.05;  ///< share of the way to its target that a wheel's speed goes in 1 ms
  double fastest_mps = 0.0;
  double fastest_at_reset_mps = 0.0;
  std::size_t sent = 0;
  std::string acting_in;                   ///< progress while measuring
  std::array<int, 3> sent_while_acting{};  ///< heartbeats, SYNCs, setpoints

  Commissioning() { drives.set_wheels({}); }

  void begin(bool free = true, double speed_mps = 0.5) {
    commission.emplace(config, vehicle, Commission::Options{free, speed_mps, milliseconds{20}},
                       now);
  }
  double speed_mps() const {
    return vehicle.wheel_radius_m *
           std::max(std::abs(wheels.speed_radps[0]), std::abs(wheels.speed_radps[1]));
  }
  static bool is_quick_stop(const CanFrame& frame) {
    const bool by_sdo = frame.id == 0x601 || frame.id == 0x602;
    const std::size_t at = by_sdo ? 4 : 0;
    return (by_sdo ? frame.data[0] == 0x2B && frame.data[1] == 0x40 && frame.data[2] == 0x60
                   : frame.id == 0x201 || frame.id == 0x202) &&
           frame.data[at] == canopen::kControlQuickStop;
  }
  void to_drives(const CanFrame& frame, std::vector<CanFrame>& back) {
    if (!takes_quick_stops && is_quick_stop(frame)) return;
    if (frame.id == canopen::kNmt && frame.data[0] == 0x81) {
      fastest_at_reset_mps = std::max(fastest_at_reset_mps, speed_mps());
    }
    drives.on_frame(frame, now, back);
  }
  void cycle(std::vector<CanFrame>& back) {
    std::vector<CanFrame> out;
    const bool acting = commission->progress() == acting_in;
    commission->tick(now, out);
    sent += out.size();
    bool has_setpoint = false;
    for (const CanFrame& frame : out) {
      has_setpoint = has_setpoint || frame.id == 0x201;
      if (!commission->may_move() && frame.id == 0x201) {
        EXPECT_EQ(frame.data[2] | frame.data[3] | frame.data[4] | frame.data[5], 0);
      }
      if (acting && commission->progress() == acting_in) {
        sent_while_acting[0] += frame.id == 0x77F ? 1 : 0;
        sent_while_acting[1] += frame.id == 0x080 ? 1 : 0;
        sent_while_acting[2] += frame.id == 0x201 || frame.id == 0x202 ? 1 : 0;
      }
      to_drives(frame, back);
    }
    const bool measuring = commission->progress().ends_with("withheld: measuring") ||
                           commission->progress() == "nothing sent: measuring";
    if (has_setpoint && !measuring) last = out;
    if (!echoes || !measuring) return;
    std::vector<CanFrame> all = last;
    all.push_back(CanFrame::make(0x77F, {0x05}));
    for (const CanFrame& frame : all) {
      const bool is_sent =
          std::ranges::any_of(out, [&](const CanFrame& other) { return other.id == frame.id; });
      const bool is_sdo = frame.id >= 0x580 && frame.id < 0x680;
      if (!is_sent && !is_sdo) to_drives(frame, back);
    }
  }
  void run(milliseconds time) {
    for (const Instant end = now + time; now < end && !commission->done();) {
      now += milliseconds{1};
      const auto targets = drives.wheel_targets_radps();
      for (std::size_t i = 0; i < 2; ++i) {
        wheels.speed_radps[i] += (targets[i] - wheels.speed_radps[i]) * follows;
        wheels.angle_rad[i] += wheels.speed_radps[i] * 1e-3;
      }
      fastest_mps = std::max(fastest_mps, speed_mps());
      drives.set_wheels(wheels);
      std::vector<CanFrame> back;
      drives.tick(now, back);
      if (now.time_since_epoch() % milliseconds{20} == Duration{0}) cycle(back);
      for (const CanFrame& frame : back) commission->on_frame(frame, now);
    }
  }
  void run_to_the_end() {
    run(std::chrono::minutes{3});
    ASSERT_TRUE(commission->done()) << commission->progress();
    EXPECT_LE(speed_mps(), config.standstill_radps * vehicle.wheel_radius_m);
  }
  std::string problem(std::size_t axis, Trial trial) const {
    for (const auto& result : commission->record().results) {
      const std::string side = axis == 0 ? "left" : "right";
      if (result.trial == trial_name(trial) && result.drive.starts_with(side))
        return result.problem;
    }
    return "no result";
  }
};

TEST_F(Commissioning, DrivesThatStopPassEveryTrial) {
  begin();
  run_to_the_end();
  EXPECT_THAT(commission->failure(), IsEmpty());
  EXPECT_EQ(commission->record().results.size(), 12U);
  for (const Trial trial : kTrials) {
    EXPECT_THAT(problem(0, trial), IsEmpty()) << trial_name(trial);
    EXPECT_THAT(problem(1, trial), IsEmpty()) << trial_name(trial);
  }
  EXPECT_TRUE(commission->record().passed());
  EXPECT_FALSE(commission->may_move());
  EXPECT_EQ(commission->record().settings, commissioned_settings(config, vehicle.wheel_radius_m));
  EXPECT_EQ(commission->record().objects.size(), recorded_objects(config).size());
  EXPECT_EQ(commission->record().wheels, "free");
  EXPECT_NEAR(fastest_mps, 0.5, 0.02);
  EXPECT_LT(fastest_at_reset_mps, 0.02);
}

TEST_F(Commissioning, DrivesOfEveryCia402FilePass) {
  for (const char* file : {"dual_axis_cia402.toml", "zlac8015d.toml"}) {
    config =
        std::get<Cia402Config>(load_drivetrain(in_source(std::string("/drivetrains/") + file)));
    now = kStart;
    wheels = {};
    drives = EmulatedCia402(config, kStart);
    drives.set_wheels({});
    begin();
    run_to_the_end();
    EXPECT_THAT(commission->failure(), IsEmpty()) << file;
    EXPECT_TRUE(commission->record().passed()) << file << "\n" << to_toml(commission->record());
  }
}

TEST_F(Commissioning, OnTheFloorItIsSlow) {
  begin(false, 0.05);
  run_to_the_end();
  EXPECT_TRUE(commission->record().passed());
  EXPECT_LT(fastest_mps, 0.055);
  EXPECT_EQ(commission->record().wheels, "on the floor");
}

TEST_F(Commissioning, OnlyWhatIsWithheldIsMissing) {
  const auto missing = [&](const char* trial) {
    now = kStart;
    wheels = {};
    drives = EmulatedCia402(config, kStart);
    drives.set_wheels({});
    sent_while_acting = {};
    acting_in = std::string(trial) + ": measuring";
    begin();
    run_to_the_end();
    return std::array{sent_while_acting[0] == 0, sent_while_acting[1] == 0,
                      sent_while_acting[2] == 0};
  };
  EXPECT_EQ(missing("nothing sent"), (std::array{true, true, true}));
  EXPECT_EQ(missing("heartbeat withheld"), (std::array{true, false, false}));
  EXPECT_EQ(missing("SYNC withheld"), (std::array{false, true, false}));
  EXPECT_EQ(missing("setpoints withheld"), (std::array{false, false, true}));
}

TEST_F(Commissioning, AWatchdogThatDoesNotActIsAProblemAndTheWheelsAreStopped) {
  echoes = true;
  begin();
  run_to_the_end();
  EXPECT_FALSE(commission->record().passed());
  EXPECT_THAT(problem(0, Trial::silence),
              HasSubstr("nothing sent: it drives on, its watchdog does not act ("));
  EXPECT_THAT(problem(1, Trial::heartbeat),
              HasSubstr("heartbeat withheld: it drives on, its watchdog does not act ("));
  EXPECT_THAT(problem(0, Trial::sync),
              HasSubstr("SYNC withheld: it drives on and reports as before"));
  EXPECT_THAT(problem(0, Trial::setpoints), IsEmpty()) << "the file does not require a deadline";
}

TEST_F(Commissioning, ARequiredDeadlineOfSetpointsHasToAct) {
  for (PdoConfig& pdo : config.pdos) pdo.event_timer_required = !pdo.transmit;
  echoes = true;
  begin();
  run_to_the_end();
  EXPECT_THAT(problem(0, Trial::setpoints),
              HasSubstr("setpoints withheld: it drives on, its watchdog does not act ("));
}

TEST_F(Commissioning, AFrozenEncoderEndsItAndNothingElseIsTried) {
  drives.inject({2, DriveFault::Kind::encoder_freeze, 0.0}, now);
  begin();
  run_to_the_end();
  EXPECT_EQ(commission->record().results.size(), 2U);
  EXPECT_THAT(problem(0, Trial::feedback), IsEmpty());
  EXPECT_THAT(problem(1, Trial::feedback), HasSubstr("do not agree with the setpoint"));
  EXPECT_THAT(commission->failure(), HasSubstr("nothing else was tried"));
}

TEST_F(Commissioning, AWrongScaleIsNamedByTheSourceThatDiffers) {
  // Only the bridge's config; the drives have the file's.
  config.axes[1].actual_velocity_per_rps.num *= 2;
  begin();
  run_to_the_end();
  EXPECT_THAT(problem(1, Trial::feedback),
              HasSubstr("velocity does not agree with the setpoint (-50 %)"));
  EXPECT_THAT(problem(0, Trial::feedback), IsEmpty());
}

TEST_F(Commissioning, AQuickStopWeakerThanHalfOfTheConfiguredOneIsAProblem) {
  follows = 0.005;
  begin();
  run_to_the_end();
  EXPECT_THAT(problem(0, Trial::quick_stop),
              HasSubstr("less than half of the configured 4.02 m/s²"));
}

TEST_F(Commissioning, AQuickStopThatDoesNotActIsAProblemAndThePowerIsCutInTheEnd) {
  // Nor do setpoints stay away: the deadline would stop the drives.
  for (PdoConfig& pdo : config.pdos) {
    if (!pdo.transmit) pdo.event_timer_ms = 0;
  }
  drives = EmulatedCia402(config, kStart);
  drives.set_wheels({});
  takes_quick_stops = false;
  begin();
  run_to_the_end();
  EXPECT_THAT(problem(0, Trial::feedback), IsEmpty());
  EXPECT_THAT(problem(1, Trial::quick_stop), HasSubstr("the quick stop does not stop it"));
  EXPECT_EQ(problem(0, Trial::silence), "no result");
  EXPECT_THAT(commission->failure(), HasSubstr("use the hard-wired emergency stop"));
}

TEST_F(Commissioning, AbortStopsTheWheelsFirst) {
  begin();
  while (fastest_mps < 0.4) run(milliseconds{20});
  commission->abort();
  run_to_the_end();
  EXPECT_THAT(commission->failure(), HasSubstr("interrupted"));
}

TEST_F(Commissioning, NothingIsSentToDrivesOfAnotherMaster) {
  begin();
  run(milliseconds{100});
  commission->on_frame(CanFrame::make(0x77F, {0x05}), now);
  run_to_the_end();
  EXPECT_EQ(sent, 0U);
  EXPECT_THAT(commission->failure(), HasSubstr("another bridge or master runs on this bus"));
}

TEST_F(Commissioning, DrivesThatAreNotThereEndItInTime) {
  drives.inject({2, DriveFault::Kind::silence, 0.0}, now);
  begin();
  run_to_the_end();
  EXPECT_THAT(commission->failure(), HasSubstr("right drive (node 2)"));
}

}  // namespace
}  // namespace tether
