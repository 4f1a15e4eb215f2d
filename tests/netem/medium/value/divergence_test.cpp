#include "netem/medium/divergence.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <tether/counters_t.hpp>
#include <tether/plan_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/twist_t.hpp>

namespace tether {
namespace {

template <class Message>
std::vector<std::uint8_t> bytes(const Message& message) {
  std::vector<std::uint8_t> out(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(out.data(), 0, static_cast<int>(out.size()));
  return out;
}

std::vector<std::uint8_t> pose(double x_m, double y_m, double yaw_rad) {
  pose_t m{};
  m.x_m = x_m, m.y_m = y_m, m.yaw_rad = yaw_rad;
  return bytes(m);
}

/// Steps of 0.1 s.
std::vector<std::uint8_t> plan(double start_s, std::vector<float> v_mps, float omega_radps = 0.0F) {
  plan_t m{};
  m.start_utime = std::llround(1e6 * start_s);
  m.step_us = 100'000;
  m.count = static_cast<std::int32_t>(v_mps.size());
  m.omega_radps.assign(v_mps.size(), omega_radps);
  m.v_mps = std::move(v_mps);
  return bytes(m);
}

TEST(Divergence, OfPosesIsTheWayOfAPointAMetreAhead) {
  EXPECT_DOUBLE_EQ(divergence_m(pose(3, 4, 0), pose(0, 0, 0)), 5.0);
  EXPECT_DOUBLE_EQ(divergence_m(pose(1, 1, std::numbers::pi), pose(1, 1, 0)), 2.0);
  EXPECT_NEAR(divergence_m(pose(1, 1, 2 * std::numbers::pi), pose(1, 1, 0)), 0.0, 1e-12);
}

TEST(Divergence, OfAPlanThatGoesOnAsTheKnownOneIsNone) {
  const std::vector<float> rising{1, 2, 3, 4, 5, 6, 7, 8, 9, 10};
  EXPECT_NEAR(divergence_m(plan(0.3, {4, 5, 6, 7, 8, 9, 10, 11}), plan(0.0, rising)), 0.0, 1e-12);
}

// 1 m/s more, for a second or for as long as both last; turning by ω on an arc of v/ω.
TEST(Divergence, OfPlansIsHowFarApartTheyLeadWithinASecond) {
  EXPECT_NEAR(divergence_m(plan(0, std::vector<float>(40, 2)), plan(0, std::vector<float>(40, 1))),
              1.0, 1e-9);
  EXPECT_NEAR(
      divergence_m(plan(0.25, std::vector<float>(40, 2)), plan(0, std::vector<float>(5, 1))), 0.25,
      1e-9);
  const double r = 2.0 / 0.5, angle = 0.5;
  EXPECT_NEAR(
      divergence_m(plan(0, std::vector<float>(40, 2), 0.5F), plan(0, std::vector<float>(40, 2))),
      std::hypot(r * std::sin(angle) - 2.0, r * (1 - std::cos(angle))), 1e-6);
}

TEST(Divergence, OfAPlanAfterOneThatIsOverIsInfinite) {
  EXPECT_EQ(divergence_m(plan(1.0, {1}), plan(0.0, std::vector<float>(10, 1))),
            std::numeric_limits<double>::infinity());
}

TEST(Divergence, OfTwistsIsThatOfOneSecond) {
  twist_t a{}, b{};
  a.v_mps = 1.5, b.v_mps = 0.5;
  EXPECT_NEAR(divergence_m(bytes(a), bytes(b)), 1.0, 1e-12);
}

TEST(Divergence, OfWhatIsNoneOfTheseIsNone) {
  EXPECT_EQ(divergence_m(bytes(counters_t{}), bytes(counters_t{})), 0.0);
  EXPECT_EQ(divergence_m(pose(3, 4, 0), plan(0, {1})), 0.0);
  EXPECT_EQ(divergence_m({1, 2, 3}, pose(0, 0, 0)), 0.0);
  EXPECT_EQ(divergence_m(plan(0, {}), plan(0, {1})), 0.0);
  EXPECT_EQ(divergence_m(pose(std::nan(""), 0, 0), pose(0, 0, 0)), 0.0);
}

}  // namespace
}  // namespace tether
