#include "can_bridge/cia402/fault_latch.hpp"

#include <gtest/gtest.h>

#include "tests/can_bridge/cia402/bench.hpp"

namespace tether::cia402 {
namespace {

using ::tether::test::two_nodes;

struct Latch {
  void fault(const Fault& f) { latch.latch(f, stage, axes); }

  FaultLatch latch;
  StageClock stage;
  Axes axes{two_nodes(), 0.1, 0.5};
};

TEST(FaultLatch, TheFirstFaultIsReported) {
  Latch l;
  l.stage.enter(Stage::enabled);
  l.fault({"first"});
  l.fault({"second"});
  EXPECT_EQ(l.stage.stage(), Stage::faulted);
  EXPECT_EQ(l.stage.reason(), "first");
  EXPECT_FALSE(l.latch.needs_restart());
}

TEST(FaultLatch, MissingFeedbackGivesWayToAnyOtherCause) {
  Latch l;
  l.stage.enter(Stage::enabled);
  l.fault({"no feedback", false, Fault::Cause::feedback});
  l.fault({"no feedback of the other", false, Fault::Cause::feedback});
  EXPECT_EQ(l.stage.reason(), "no feedback");
  l.fault({"no heartbeat", true});
  EXPECT_EQ(l.stage.reason(), "no heartbeat");
  EXPECT_TRUE(l.latch.needs_restart());
}

TEST(FaultLatch, ALaterFaultMayStillAskForARestart) {
  Latch l;
  l.stage.enter(Stage::enabled);
  l.fault({"first"});
  l.fault({"rebooted", true});
  EXPECT_EQ(l.stage.reason(), "first");
  EXPECT_TRUE(l.latch.needs_restart());
  l.latch.clear();
  EXPECT_FALSE(l.latch.needs_restart());
}

TEST(FaultLatch, BeforeAllDrivesAreConfiguredEveryFaultNeedsARestart) {
  Latch l;
  l.stage.enter(Stage::activating);
  l.fault({"any"});
  EXPECT_TRUE(l.latch.needs_restart());
}

TEST(FaultLatch, NeitherBeforeTheStartNorWhenRefused) {
  Latch l;
  l.fault({"any", true});
  EXPECT_EQ(l.stage.stage(), Stage::idle);
  l.stage.enter(Stage::refused, "why");
  l.fault({"any", true});
  EXPECT_EQ(l.stage.stage(), Stage::refused);
  EXPECT_EQ(l.stage.reason(), "why");
  EXPECT_FALSE(l.latch.needs_restart());
}

TEST(FaultLatch, AxesBrakeBeforeTheirPowerGoesOff) {
  Latch l;
  l.axes.release();
  l.stage.enter(Stage::enabled);
  l.fault({"any"});
  EXPECT_FALSE(l.axes.released(0));
  EXPECT_FALSE(l.axes.released(1));
}

TEST(FaultLatch, AnErrorCodeThatComesLaterIsReported) {
  Latch l;
  l.stage.enter(Stage::enabled);
  l.fault(fault_of_axis(l.axes, 1));
  EXPECT_EQ(l.stage.reason(),
            "right drive (node 2): fault, error code not known yet: remove the cause, then reset");
  l.axes[1].on_emergency(0x2320);
  l.latch.tell_error_code(l.stage, l.axes);
  EXPECT_EQ(l.stage.reason(),
            "right drive (node 2): fault 0x2320 (short circuit or earth leakage): remove the "
            "cause, then reset");
}

}  // namespace
}  // namespace tether::cia402
