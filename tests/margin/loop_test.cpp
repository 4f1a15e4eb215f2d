#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/scenario/scenario.hpp"
#include "controller/laws/tracking_feedback.hpp"
#include "margin/loop/loop_margins.hpp"
#include "margin/theory/sampled_loop.hpp"

namespace tether {
namespace {

Scenario paper(std::vector<std::string> more = {}) {
  std::vector<std::string> set{"controller.law=tracking", "sensor.rate_hz=20"};
  set.insert(set.end(), more.begin(), more.end());
  return load_scenario(TETHER_SOURCE_DIR "/scenarios/paper.toml", set);
}

/// The shipping law at `reference`, by central differences in the vehicle's errors.
LawJacobian numerical(const ControllerSettings& settings, const PathPoint& reference) {
  const TrackingFeedback law(settings, 3.0);
  constexpr double kStep = 1e-5;
  LawJacobian k;
  for (int i = 0; i < 3; ++i) {
    const auto at = [&](double by) {
      const double x_e = i == 0 ? by : 0.0, y_e = i == 1 ? by : 0.0, theta_e = i == 2 ? by : 0.0;
      const double yaw = reference.yaw_rad - theta_e, c = std::cos(yaw), s = std::sin(yaw);
      return law.command(
          {reference.x_m - c * x_e + s * y_e, reference.y_m - s * x_e - c * y_e, yaw}, reference);
    };
    const Twist more = at(kStep), less = at(-kStep);
    k(0, i) = (more.v_mps - less.v_mps) / (2.0 * kStep);
    k(1, i) = (more.omega_radps - less.omega_radps) / (2.0 * kStep);
  }
  return k;
}

TEST(TrackingJacobianTest, IsThatOfTheShippingLawOnStraightsAndCurvesAtAnySpeed) {
  const ControllerSettings settings;
  const TrackingGains& g = settings.tracking;
  for (const double v : {0.2, 0.9, 2.0, 2.87}) {
    for (const double omega : {-0.5, 0.0, 0.4}) {
      const LawJacobian by_hand = tracking_jacobian(g.k_x, g.k_y, g.k_theta, v);
      const LawJacobian law = numerical(settings, {3.0, -2.0, 0.7, v, omega});
      EXPECT_TRUE(law.isApprox(by_hand, 1e-4)) << v << ' ' << omega << '\n' << law;
    }
  }
}

TEST(LoopMarginsTest, OfTheEightAreAtItsTopSpeed) {
  const LoopMargins m = loop_margins(paper());
  EXPECT_NEAR(m.v_mps, 2.0 * std::sqrt(2.0), 1e-4);
  EXPECT_NEAR(m.least_mps, std::sqrt(4.0 * 0.4375), 1e-3);  // 2 √(cos²θ + cos²2θ) at cos 2θ = −1/4
  ASSERT_EQ(m.prr_each_way.kind, Critical::Kind::found);
  EXPECT_NEAR(m.prr_each_way.value, 0.537, 2e-3);
}

TEST(LoopMarginsTest, StableIsWhatIsAboveTheCriticalPrr) {
  EXPECT_LT(loop_margins(paper({"channel.prr=0.55"})).radius, 1.0);
  EXPECT_GT(loop_margins(paper({"channel.prr=0.52"})).radius, 1.0);
}

TEST(LoopMarginsTest, IndependentLossInFrontOfALinkCountsAsItsPrr) {
  const LoopMargins one = loop_margins(paper({"channel.prr=0.56"}));
  const LoopMargins other = loop_margins(paper({"channel.prr=0.7", "channel.loss=0.2"}));
  EXPECT_NEAR(one.radius, other.radius, 1e-7);
}

TEST(LoopMarginsTest, LongerBurstsAreWorseAtTheSamePrr) {
  const auto burst = [](const std::string& mean) {
    return loop_margins(paper({"channel.model=gilbert_elliott", "channel.gilbert_elliott.prr=0.8",
                               "channel.gilbert_elliott.mean_burst=" + mean}));
  };
  const LoopMargins short_ones = burst("1.5"), long_ones = burst("20");
  EXPECT_NEAR(short_ones.prr, 0.64, 1e-9);
  EXPECT_LT(short_ones.radius, 1.0);
  EXPECT_GT(long_ones.radius, 1.0);
  ASSERT_TRUE(short_ones.mean_burst);
  ASSERT_EQ(short_ones.mean_burst->kind, Critical::Kind::found);
  EXPECT_NEAR(short_ones.mean_burst->value, long_ones.mean_burst->value, 1e-2);
  EXPECT_GT(short_ones.mean_burst->value, 1.5);
  EXPECT_LT(short_ones.mean_burst->value, 20.0);
}

TEST(LoopMarginsTest, MoreNoiseIsMoreErrorInProportion) {
  const auto noisy = [](const std::string& m, const std::string& rad) {
    return loop_margins(paper({"sensor.position_noise_m=" + m, "sensor.yaw_noise_rad=" + rad}));
  };
  const LoopMargins one = noisy("0.01", "0.005"), two = noisy("0.02", "0.01");
  ASSERT_TRUE(one.rms_m && two.rms_m);
  EXPECT_GT(*one.rms_m, 0.001);
  EXPECT_NEAR(*two.rms_m, 2.0 * *one.rms_m, 1e-6);
}

TEST(LoopMarginsTest, RefusesByNameWhatTheTheoryDoesNotHoldFor) {
  const auto refusal = [](const std::vector<std::string>& set) -> std::string {
    try {
      loop_margins(paper(set));
    } catch (const UsageError& error) {
      return error.what();
    }
    return "";
  };
  using testing::HasSubstr;
  EXPECT_THAT(refusal({"controller.law=pid"}), HasSubstr("controller.law = \"pid\""));
  EXPECT_THAT(refusal({"controller.trigger=timer"}), HasSubstr("controller.trigger"));
  EXPECT_THAT(refusal({"controller.pose_timeout_s=0.4"}), HasSubstr("controller.pose_timeout_s"));
  EXPECT_THAT(refusal({"sensor.send=changed"}), HasSubstr("sensor.send"));
  EXPECT_THAT(refusal({"channel.uplink.jitter.law=gamma", "channel.uplink.jitter.mean_ms=20",
                       "channel.uplink.jitter.sd_ms=10"}),
              HasSubstr("channel.uplink.jitter"));
  EXPECT_THAT(refusal({"channel.downlink.model=markov"}), HasSubstr("channel.downlink.model"));
  EXPECT_THAT(refusal({"vehicle.actuator_lag_ms=50"}), HasSubstr("vehicle.radius_error"));
  EXPECT_THAT(refusal({"controller.law=predictive", "actuator.policy=horizon"}),
              testing::AllOf(HasSubstr("controller.law"), HasSubstr("actuator.policy")));
  EXPECT_EQ(refusal({}), "");
}

}  // namespace
}  // namespace tether
