#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <string>
#include <tether/drive_fault_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <tether/ground_truth_t.hpp>
#include <vector>

#include "common/base/errors.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/support/virtual_world.hpp"
#include "tests/tools/runs/run_files.hpp"
#include "tools/nodes/closed_loop.hpp"

// Safety inputs on CAN in the whole loop, in virtual time. They need neither LCM nor the network.

namespace tether {
namespace {

using test::at_s;
using test::contents;
using test::Folder;
using ::testing::HasSubstr;

/// The usual drivetrain with one input, at 0x3A0, silent from 100 ms on.
struct Vehicle {
  explicit Vehicle(const std::string& input, const std::string& kind = "can",
                   std::vector<std::string> overrides = {}) {
    const auto file = folder.path / "drivetrain.toml";
    std::ofstream(file) << contents(in_source("/drivetrains/two_node_cia402.toml"))
                        << "[[safety_input]]\nname = \"field\"\n"
                        << input << "kind = \"" << kind << "\"\n"
                        << (kind == "can" ? "id = 0x3A0\nlength = 1\nbyte = 0\nmask = 0x03\n"
                                            "clear = 0x01\nstop = 0x02\ntimeout_ms = 100\n"
                                          : "chip = \"gpiochip0\"\nline = 17\n");
    overrides.emplace_back("can.drivetrain=" + file.string());
    overrides.emplace_back("run.duration_s=20");
    loop = std::make_unique<ClosedLoop>(
        load_scenario(in_source("/scenarios/hil_vcan.toml"), overrides));
    keep("CAN/STATE", state);
    keep("SIM/TRUTH", truth);
  }
  template <class LcmType>
  void keep(const std::string& channel, LcmType& newest) {
    subscribe<LcmType>(loop->bus(), channel, kDeepQueue, undecodable,
                       [&newest](const LcmType& m) { newest = m; });
  }
  /// Action of the emulated input from then on.
  void act_at(double s, std::int32_t kind, double value = 0.0) {
    loop->loop().at(at_s(s), Priority::node, [this, s, kind, value](Instant) {
      drive_fault_t m{};
      m.utime = to_utime(at_s(s));
      m.seq = acts++;
      m.node = kind == drive_fault_t::NONE ? 0 : 1;
      m.kind = kind;
      m.value = value;
      publish(loop->bus(), "CAN/INJECT", m);
    });
  }
  void run_to(double s) { loop->run_until(at_s(s)); }
  bool armed() const { return state.state == drivetrain_state_t::ARMED; }
  double rim_mps() const {
    return std::max(std::abs(truth.left_rim_mps), std::abs(truth.right_rim_mps));
  }

  Folder folder;
  std::unique_ptr<ClosedLoop> loop;
  drivetrain_state_t state{};
  ground_truth_t truth{};
  std::int64_t undecodable = 0;
  std::int64_t acts = 0;
};

const std::string kProtectiveStop = "function = \"protective_stop\"\n";

TEST(CanInput, WhileItIsClearTheVehicleDrives) {
  Vehicle v(kProtectiveStop);
  v.run_to(20.0);
  EXPECT_TRUE(v.armed()) << v.state.reason;
  EXPECT_GT(v.rim_mps(), 0.5);
}

struct Act {
  const char* name;
  double value;         ///< value of drive_fault_t::SAFETY_INPUT
  double noticed_in_s;  ///< a cycle and a frame; silence: its timeout more
};
struct EachAct : ::testing::TestWithParam<Act> {};

TEST_P(EachAct, OfAProtectiveStopStopsTheVehicleForGood) {
  Vehicle v(kProtectiveStop);
  v.act_at(10.0, drive_fault_t::SAFETY_INPUT, GetParam().value);
  v.act_at(13.0, drive_fault_t::NONE);
  v.run_to(10.0);
  ASSERT_TRUE(v.armed()) << v.state.reason;
  ASSERT_GT(v.rim_mps(), 1.5);
  v.run_to(10.0 + GetParam().noticed_in_s);
  EXPECT_FALSE(v.armed());
  EXPECT_THAT(v.state.reason, HasSubstr("safety input field"));
  v.run_to(11.0);
  EXPECT_LT(v.rim_mps(), 0.02);
  v.run_to(20.0);
  EXPECT_EQ(v.state.state, drivetrain_state_t::DISARMED);
  EXPECT_LT(v.rim_mps(), 0.02);
}

INSTANTIATE_TEST_SUITE_P(CanInput, EachAct,
                         ::testing::Values(Act{"demand", 0, 0.025}, Act{"silence", 1, 0.125},
                                           Act{"nonsense", 2, 0.025}),
                         [](const auto& info) { return std::string(info.param.name); });

TEST(CanInput, AProtectiveStopThatMayRestartGoesOn2sAfterItIsClear) {
  Vehicle v(kProtectiveStop + "restart_after_s = 2.0\n");
  v.act_at(10.0, drive_fault_t::SAFETY_INPUT, 0.0);
  v.act_at(13.0, drive_fault_t::NONE);
  v.run_to(12.9);
  EXPECT_TRUE(v.armed());
  EXPECT_LT(v.rim_mps(), 0.02);
  v.run_to(14.98);
  EXPECT_LT(v.rim_mps(), 0.02);
  v.run_to(16.0);
  EXPECT_TRUE(v.armed()) << v.state.reason;
  EXPECT_GT(v.rim_mps(), 0.1);
  EXPECT_EQ(v.state.disarms, 0);
}

TEST(CanInput, AWarningFieldSlowsTheVehicleDown) {
  Vehicle v("function = \"speed_limit\"\nspeed_limit_mps = 0.3\n");
  v.act_at(10.0, drive_fault_t::SAFETY_INPUT, 0.0);
  v.act_at(13.0, drive_fault_t::NONE);
  v.run_to(10.0);
  ASSERT_GT(v.rim_mps(), 1.5);
  v.run_to(12.0);
  EXPECT_THAT(v.state.reason, HasSubstr("limited to 0.3 m/s by safety input field"));
  for (double t = 12.0; t < 13.0; t += 0.1) {
    v.run_to(t);
    EXPECT_LT(v.rim_mps(), 0.32) << t;
  }
  v.run_to(16.0);
  EXPECT_GT(v.rim_mps(), 0.5);
  EXPECT_TRUE(v.armed());
}

TEST(CanInput, TheContactOfTheEStopChainIsAnEStop) {
  Vehicle v("function = \"estop_status\"\n");
  v.act_at(10.0, drive_fault_t::SAFETY_INPUT, 0.0);
  v.act_at(13.0, drive_fault_t::NONE);
  v.run_to(10.0);
  ASSERT_TRUE(v.armed()) << v.state.reason;
  v.run_to(12.0);
  EXPECT_EQ(v.state.state, drivetrain_state_t::ESTOP);
  EXPECT_LT(v.rim_mps(), 0.02);
  v.run_to(20.0);
  EXPECT_EQ(v.state.state, drivetrain_state_t::ESTOP);
  EXPECT_THAT(v.state.reason, HasSubstr("released: reset to go on"));
}

TEST(CanInput, OneThatDemandsAStopFromTheBeginningPreventsArming) {
  Vehicle v(kProtectiveStop, "can",
            {"can.inject=safety_input", "can.inject_node=1", "can.inject_at_s=-4"});
  v.run_to(5.0);
  EXPECT_EQ(v.state.state, drivetrain_state_t::DISARMED);
  EXPECT_THAT(v.state.reason, HasSubstr("safety input field demands a stop"));
}

TEST(CanInput, GpioLinesAreRefusedInVirtualTime) {
  EXPECT_THROW(Vehicle(kProtectiveStop, "gpio"), UsageError);
}

TEST(CanInput, AnInputThatTheDrivetrainHasNotIsRefused) {
  EXPECT_THROW(Vehicle(kProtectiveStop, "can", {"can.inject=safety_input", "can.inject_node=2"}),
               UsageError);
}

}  // namespace
}  // namespace tether
