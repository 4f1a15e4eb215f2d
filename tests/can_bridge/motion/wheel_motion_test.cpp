#include "can_bridge/safety/wheel_motion.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace tether {
namespace {

using std::chrono::milliseconds;

constexpr double kStandstill_radps = 0.05, kCount_rad = 0.001;
Instant at_ms(int ms) { return kStart + milliseconds(ms); }

struct Wheel : ::testing::Test {
  WheelMotion motion{kStandstill_radps, kCount_rad, milliseconds(100)};
  double angle_rad = 5.0;

  /// Reports every 20 ms in [from, until], of a wheel that truly turns at `radps`.
  void report(int from, int until, double radps, double reported_radps) {
    for (int t = from; t <= until; t += 20) {
      motion.on_speed(reported_radps, at_ms(t));
      motion.on_position(angle_rad, at_ms(t));
      angle_rad += radps * 0.02;
    }
  }
  Motion at(int ms) const { return motion.judge(at_ms(ms)); }
};

TEST_F(Wheel, IsUnknownBeforeTheFirstReport) {
  EXPECT_EQ(at(0), Motion::unknown);
  EXPECT_EQ(motion.newest(), Motion::unknown);
  EXPECT_FALSE(motion.fastest_radps(at_ms(0)));
}

TEST_F(Wheel, StandsOnceItsPositionsHaveStoodForTheWholeWindow) {
  report(0, 80, 0.0, 0.0);
  EXPECT_EQ(at(80), Motion::unknown);
  report(100, 100, 0.0, 0.0);
  EXPECT_EQ(at(100), Motion::standing);
}

TEST_F(Wheel, TurnsIfOneWitnessSaysSo) {
  report(0, 200, 1.0, 0.0);
  EXPECT_EQ(at(200), Motion::turning) << "by position alone";
  motion.forget();
  report(300, 500, 0.0, 1.0);
  EXPECT_EQ(at(500), Motion::turning) << "by speed alone";
  motion.forget();
  report(600, 800, 0.0, -1.0);
  EXPECT_EQ(at(800), Motion::turning) << "backwards";
}

TEST_F(Wheel, ThatSwingsAboutAPlaceTurns) {
  for (int t = 0; t <= 200; t += 20) {
    motion.on_speed(0.0, at_ms(t));
    motion.on_position(t % 40 == 0 ? 0.0 : 0.02, at_ms(t));
  }
  EXPECT_EQ(at(200), Motion::turning);
}

TEST_F(Wheel, StandsThoughItsCounterIsOnTheEdgeOfACount) {
  for (int t = 0; t <= 200; t += 20) {
    motion.on_speed(0.0, at_ms(t));
    motion.on_position(t % 40 == 0 ? 0.0 : kCount_rad, at_ms(t));
  }
  EXPECT_EQ(at(200), Motion::standing);
}

TEST_F(Wheel, IsUnknownOnceEitherWitnessIsStale) {
  report(0, 200, 0.0, 0.0);
  EXPECT_EQ(at(299), Motion::standing);
  EXPECT_EQ(at(300), Motion::unknown);
  for (int t = 220; t <= 400; t += 20) motion.on_position(angle_rad, at_ms(t));
  EXPECT_EQ(at(400), Motion::unknown) << "speed is missing";
  report(420, 600, 0.0, 0.0);
  for (int t = 620; t <= 720; t += 20) motion.on_speed(0.0, at_ms(t));
  EXPECT_EQ(at(720), Motion::unknown) << "positions are old";
  motion.forget();
  for (int t = 420; t <= 600; t += 20) motion.on_speed(0.0, at_ms(t));
  EXPECT_EQ(at(600), Motion::unknown) << "positions are missing";
}

TEST_F(Wheel, ComparesNoPositionsOverALongPauseOrAfterItsCounterWasReset) {
  report(0, 200, 0.0, 0.0);
  report(800, 880, 0.0, 0.0);
  EXPECT_EQ(at(880), Motion::unknown);
  report(900, 900, 0.0, 0.0);
  EXPECT_EQ(at(900), Motion::standing);
  motion.forget_position();
  EXPECT_EQ(at(900), Motion::unknown);
}

TEST_F(Wheel, RemembersHowItWasWhenItWasLastHeard) {
  report(0, 200, 0.0, 0.0);
  EXPECT_EQ(at(5000), Motion::unknown);
  EXPECT_EQ(motion.newest(), Motion::standing);
  report(5000, 5200, 2.0, 2.0);
  EXPECT_EQ(motion.newest(), Motion::turning);
}

TEST_F(Wheel, IsAsFastAsTheFasterWitnessSays) {
  report(0, 200, 2.0, 0.0);
  EXPECT_NEAR(*motion.fastest_radps(at_ms(200)), 2.0, 1e-9);
  motion.on_speed(-3.0, at_ms(200));
  EXPECT_EQ(*motion.fastest_radps(at_ms(200)), -3.0);
  EXPECT_FALSE(motion.fastest_radps(at_ms(300)));
}

TEST_F(Wheel, StandsByReportsOfEachMillisecondToo) {
  for (int t = 0; t <= 150; ++t) {
    motion.on_speed(0.0, at_ms(t));
    motion.on_position(t == 60 ? 0.1 : 0.0, at_ms(t));
  }
  EXPECT_EQ(at(150), Motion::turning) << "no extreme is lost";
  for (int t = 151; t <= 260; ++t) {
    motion.on_speed(0.0, at_ms(t));
    motion.on_position(0.0, at_ms(t));
  }
  EXPECT_EQ(at(260), Motion::standing);
}

}  // namespace
}  // namespace tether
