#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "sim/sensor/pose_sensor.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;

SensorSettings at_20_hz(double delta_m, double max_age_s) {
  SensorSettings settings;
  settings.send = SensorSettings::Send::changed;
  settings.send_delta_m = delta_m;
  settings.send_max_age_s = max_age_s;
  return settings;
}

/// When the poses of pose(t_s) are sent that are measured 20 times a second for 10 s, t = 10 s too.
template <class PoseAt>
std::vector<double> sent_at(const SensorSettings& settings, PoseAt pose) {
  PoseSending sending(settings);
  std::vector<double> times;
  for (int i = 0; i <= 200; ++i) {
    const Instant now = kStart + i * milliseconds{50};
    if (sending.is_due(now, pose(to_seconds(now)))) times.push_back(to_seconds(now));
  }
  EXPECT_EQ(sending.sampled(), 201);
  EXPECT_EQ(sending.sent(), static_cast<std::int64_t>(times.size()));
  return times;
}

TEST(PoseSending, OfAVehicleThatStandsSendsAsSeldomAsTheAgeLimitAllows) {
  const auto times = sent_at(at_20_hz(0.1, 2.0), [](double) { return Pose2{3.0, 4.0, 1.0}; });
  EXPECT_EQ(times, (std::vector<double>{0.0, 2.0, 4.0, 6.0, 8.0, 10.0}));
}

TEST(PoseSending, KeepsTheAgeLimitWhereItIsNoMultipleOfThePeriod) {
  const auto times = sent_at(at_20_hz(0.1, 0.33), [](double) { return Pose2{}; });
  for (std::size_t i = 1; i < times.size(); ++i) EXPECT_NEAR(times[i] - times[i - 1], 0.3, 1e-9);
}

// At a constant speed v the first sample that is farther than d comes after ⌊d f / v⌋ + 1 periods.
TEST(PoseSending, AtConstantSpeedSendsOnceInTheFirstWholePeriodBeyondTheDelta) {
  for (const double v_mps : {0.3, 0.7, 1.1, 3.3}) {
    const auto times = sent_at(at_20_hz(0.25, 5.0), [&](double t_s) {
      return Pose2{v_mps * t_s, 0.0, 0.0};
    });
    const double gap_s = (std::floor(0.25 * 20.0 / v_mps) + 1.0) / 20.0;
    ASSERT_GT(times.size(), 2U);
    for (std::size_t i = 1; i < times.size(); ++i) {
      EXPECT_NEAR(times[i] - times[i - 1], gap_s, 1e-9) << v_mps;
    }
  }
}

TEST(PoseSending, SendsATurnToo) {
  auto settings = at_20_hz(1.0, 5.0);
  settings.send_delta_rad = 0.2;
  const auto times = sent_at(settings, [](double t_s) {
    return Pose2{0.0, 0.0, wrap_angle(std::numbers::pi - 0.5 + 0.45 * t_s)};  // through ±π
  });
  ASSERT_GT(times.size(), 10U);
  for (std::size_t i = 1; i < times.size(); ++i) EXPECT_NEAR(times[i] - times[i - 1], 0.45, 1e-9);
}

// The receiver's value is never farther off than the delta at a sampling instant, however the
// vehicle moves.
TEST(PoseSending, LeavesTheReceiverOffByNoMoreThanTheDelta) {
  const auto pose = [](double t_s) {
    return Pose2{2.0 * std::sin(t_s), 0.3 * t_s * std::cos(3.0 * t_s), 0.4 * std::sin(2.0 * t_s)};
  };
  PoseSending sending(at_20_hz(0.15, 1.0));
  Pose2 held;
  int kept = 0;
  for (int i = 0; i <= 400; ++i) {
    const Instant now = kStart + i * milliseconds{50};
    const Pose2 now_at = pose(to_seconds(now));
    if (sending.is_due(now, now_at)) {
      held = now_at;
    } else {
      ++kept;
    }
    EXPECT_LE(std::hypot(now_at.x_m - held.x_m, now_at.y_m - held.y_m), 0.15);
    EXPECT_LE(std::abs(now_at.yaw_rad - held.yaw_rad), 0.1);
  }
  EXPECT_GT(kept, 50);
}

}  // namespace
}  // namespace tether
