#include "controller/estimation/wheel_readings.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;
using testing::at_ms;

constexpr double kRead_s = 0.05;

Twist command_at(double t_s) {  // speeds up and slows down, or a lag could not be seen
  return {2.0 + std::sin(2.0 * t_s), 0.3 * std::sin(t_s)};
}

/// A vehicle that does what it is told, while the filter believes in a lag of 100 ms; no poses.
struct LagRig {
  PoseFilter filter{{.lag_ms = 100.0}, {.lag = true}, {}, {}};
  MotionModel model{{}};
  MotionModel::State truth;

  void drive(double seconds, bool reads) {
    for (double t_s = 0.0; t_s < seconds; t_s += kRead_s) {
      filter.advance(command_at(t_s), kRead_s);
      model.advance(truth, command_at(t_s), kRead_s);
      if (reads) filter.update_wheels(model.twist(truth));
    }
  }
  double lag_s() const { return filter.model().drive().lag_s; }
};

TEST(WheelReadings, FindALagThatIsBelievedButAbsentWithoutAnyPose) {
  LagRig with, without;
  with.drive(30.0, true);
  without.drive(30.0, false);
  EXPECT_EQ(without.lag_s(), 0.1);
  EXPECT_LT(with.lag_s(), 0.05);
  EXPECT_GT(with.filter.wheels_used(), 500);
}

TEST(WheelReadings, AReadingThatIsFarOffChangesNothing) {
  LagRig rig;
  rig.drive(5.0, true);
  const auto before = rig.filter.values();
  rig.filter.update_wheels({100.0, 0.0});
  EXPECT_EQ(rig.filter.values(), before);
}

TEST(WheelReadings, AreUsedInOrderUpToThePoseAndNotBefore) {
  WheelReadings readings;
  for (const int ms : {10, 20, 30, 40}) readings.add(at_ms(ms), {});
  PoseFilter filter({}, {}, {}, {});
  std::vector<Instant> moved;
  const auto move = [&](Instant until) { moved.push_back(until); };
  readings.use(at_ms(10), at_ms(35), filter, move);
  EXPECT_EQ(moved, (std::vector<Instant>{at_ms(20), at_ms(30), at_ms(35)}));
  EXPECT_EQ(filter.wheels_used(), 2);
  moved.clear();
  readings.use(at_ms(35), at_ms(40), filter, move);
  EXPECT_EQ(moved, (std::vector<Instant>{at_ms(40), at_ms(40)}))
      << "one at the pose's own stamp, too";
  EXPECT_EQ(filter.wheels_used(), 3);
}

}  // namespace
}  // namespace tether
