#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/scenario.hpp"
#include "controller/laws/pid_law.hpp"
#include "controller/laws/tracking_law.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/margin/loop_margins.hpp"
#include "tools/margin/sampled_loop.hpp"
#include "tools/margin/survival.hpp"

namespace tether {
namespace {

Scenario paper(std::vector<std::string> more = {}) {
  std::vector<std::string> set{"controller.law=tracking", "sensor.rate_hz=20"};
  set.insert(set.end(), more.begin(), more.end());
  return load_scenario(in_source("/scenarios/paper.toml"), set);
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

/// On a straight along x at a speed v, where the vehicle is v/P behind the target.
TEST(PidJacobianTest, IsThatOfTheShippingLawWhereItFollowsAStraight) {
  const Scenario scenario =
      paper({"controller.law=pid", "controller.v.p=1.5", "controller.omega.p=3", "controller.v.d=0",
             "controller.omega.d=0", "controller.tau_s=0.4", "path.kind=line", "path.length_m=75",
             "world.half_extent_m=500"});
  const StraightLoop loop(scenario);
  EXPECT_DOUBLE_EQ(loop.v_mps, 1.5);
  EXPECT_DOUBLE_EQ(loop.behind_m, 1.0 - 1.5 * 0.4);
  const auto path = make_path(scenario.get<PathSettings>());
  constexpr double kAt_s = 20.0, kStep = 1e-6;
  const PathPoint point = path->at(kAt_s);
  const auto at = [&](double ahead_m, double left_m, double yaw_rad) {
    PidLaw law(scenario.get<ControllerSettings>(), path, 0.0);
    return law.step({point.x_m - loop.behind_m + ahead_m, left_m, yaw_rad},
                    kStart + from_seconds(kAt_s));
  };
  const Twist still = at(0.0, 0.0, 0.0);
  EXPECT_NEAR(still.v_mps, 1.5, 1e-9);
  LawJacobian k;
  for (int i = 0; i < 3; ++i) {
    const auto off = [&](double by) {
      return at(i == 0 ? -by : 0.0, i == 1 ? -by : 0.0, i == 2 ? -by : 0.0);
    };
    const Twist more = off(kStep), less = off(-kStep);
    k(0, i) = (more.v_mps - less.v_mps) / (2.0 * kStep);
    k(1, i) = (more.omega_radps - less.omega_radps) / (2.0 * kStep);
  }
  // Turned on the spot, the way to the target stays as long; its bearing turns by all of θ_e.
  EXPECT_TRUE(k.isApprox(loop.law, 1e-5)) << k << "\n\n" << loop.law;
}

double radius_of(const Scenario& scenario) {
  refuse_margin_obstacles(scenario);
  const StraightLoop loop(scenario);
  return loop.radius(loop.chain());
}

TEST(LoopMarginsTest, OneChainWrittenAsThreeModelsHasOneRadius) {
  const double ge =
      radius_of(paper({"channel.model=gilbert_elliott", "channel.gilbert_elliott.p=0.1",
                       "channel.gilbert_elliott.r=0.4"}));
  const double chain = radius_of(paper({"channel.model=chain", "channel.chain.prr=[1.0, 0.0]",
                                        "channel.chain.probabilities=[[0.9, 0.1], [0.4, 0.6]]"}));
  const double four = radius_of(paper(
      {"channel.model=four_state", "channel.four_state.p13=0.1", "channel.four_state.p31=0.4"}));
  EXPECT_NEAR(chain, ge, 1e-7);
  EXPECT_NEAR(four, ge, 1e-7);
}

TEST(LoopMarginsTest, RatesAndStepsInTimeAreOneChainAtThePosesPeriod) {
  const double cycle_s = 0.4, p_bad = 0.3;  // rates 1/(0.28 s) and 1/(0.12 s)
  const double a = -std::expm1(-0.05 * (1.0 / 0.28 + 1.0 / 0.12));
  const std::string p = std::to_string(p_bad * a), stays = std::to_string(1.0 - std::stod(p));
  const std::string r = std::to_string((1.0 - p_bad) * a),
                    back = std::to_string(1.0 - std::stod(r));
  const double markov = radius_of(
      paper({"channel.model=markov", "channel.markov.bad.prr=0", "channel.markov.bad.delay_ms=0",
             "channel.markov.good.delay_ms=0", "channel.markov.p_bad=" + std::to_string(p_bad),
             "channel.markov.mean_cycle_s=" + std::to_string(cycle_s)}));
  const double stepped = radius_of(
      paper({"channel.model=chain", "channel.chain.prr=[1.0, 0.0]", "channel.chain.step_s=0.05",
             "channel.chain.probabilities=[[" + stays + "," + p + "],[" + r + "," + back + "]]"}));
  EXPECT_NEAR(stepped, markov, 1e-5);
}

/// Where one state rules both links, a pose that arrives is a command that arrives.
TEST(LoopMarginsTest, ASharedStateLosesNoMoreThanOneLink) {
  const std::vector<std::string> markov{
      "channel.model=markov",          "channel.markov.bad.prr=0",
      "channel.markov.bad.delay_ms=0", "channel.markov.good.delay_ms=0",
      "channel.markov.p_bad=0.3",      "channel.markov.mean_cycle_s=0.4"};
  auto shared = markov, one = markov;
  shared.emplace_back("channel.shared_state=true");
  one[0] = "channel.uplink.model=markov";
  for (std::size_t i = 1; i < one.size(); ++i) one[i].insert(8, "uplink.");
  EXPECT_NEAR(StraightLoop(paper(shared)).chain().prr(), 0.7, 1e-9);
  EXPECT_NEAR(radius_of(paper(shared)), radius_of(paper(one)), 1e-7);
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

/// The vehicle is behind its aim by what rounding leaves of 0, and no noise: the mean square's own
/// rounding may be below 0.
TEST(LoopMarginsTest, ErrorsOfALoopWithoutAnyAreNoughtAndNotUndefined) {
  const LoopMargins m = loop_margins(
      paper({"controller.law=pid", "controller.v.p=1.2", "controller.omega.p=2", "controller.v.d=0",
             "controller.omega.d=0", "controller.tau_s=0.8333333333333334", "path.kind=line",
             "path.speed_mps=1", "sensor.rate_hz=5", "channel.prr=0.9"}));
  ASSERT_TRUE(m.rms_m);
  EXPECT_GE(*m.rms_m, 0.0);
  EXPECT_LT(*m.rms_m, 1e-6);
}

std::vector<std::string> noisy(double prr) {
  return {"sensor.position_noise_m=0.02",
          "sensor.yaw_noise_rad=0.01",
          "path.kind=line",
          "path.length_m=500",
          "path.speed_mps=2.87",
          "path.max_acceleration_mps2=3",
          "world.half_extent_m=600",
          "vehicle.plant=kinematic",
          "channel.prr=" + std::to_string(prr)};
}

TEST(FirstExcursionTest, ComesWithinMinutesWhereTheMeanSquareIsStable) {
  const Scenario scenario = paper(noisy(0.57));
  EXPECT_LT(loop_margins(scenario).radius, 1.0);
  const auto first = first_excursion(scenario);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->excursions, 200u);
  EXPECT_LT(first->mean_s.value, 1200.0);
}

TEST(FirstExcursionTest, ComesLaterWithFewerLossesAndNotAtAllWithFew) {
  const auto few = first_excursion(paper(noisy(0.55))), fewer = first_excursion(paper(noisy(0.6))),
             none = first_excursion(paper(noisy(0.9)));
  ASSERT_TRUE(few && fewer && none);
  EXPECT_LT(few->mean_s.high, fewer->mean_s.low);
  EXPECT_EQ(none->excursions, 0u);
  EXPECT_GT(none->mean_s.low, 3600.0);
}

TEST(FirstExcursionTest, IsNotReckonedWithoutWhiteNoiseAndForPlans) {
  auto drifts = noisy(0.9);
  drifts.emplace_back("sensor.yaw_drift_radpsqrts=0.01");
  EXPECT_FALSE(first_excursion(paper(drifts)));
  EXPECT_FALSE(first_excursion(paper({"controller.law=predictive", "actuator.policy=horizon"})));
}

TEST(AlmostSurePrrTest, IsBelowThatOfTheMeanSquare) {
  const Scenario scenario = paper(noisy(0.57));
  const Critical almost = almost_sure_prr(scenario);
  ASSERT_EQ(almost.kind, Critical::Kind::found);
  EXPECT_LT(almost.value, loop_margins(scenario).prr_each_way.value);
}

TEST(LoopMarginsTest, OfPlansAreStableAtAnyReceptionAndHaveNoDelay) {
  const std::vector<std::string> plans{"controller.law=predictive", "actuator.policy=horizon",
                                       "sensor.rate_hz=10", "channel.prr=0.3"};
  const LoopMargins m = loop_margins(paper(plans));
  EXPECT_EQ(m.prr_each_way.kind, Critical::Kind::always);
  EXPECT_FALSE(m.delays);
  // Nothing arrives in a share of 0.91 of the periods, and what is off then stays off.
  EXPECT_NEAR(m.radius, 1.0 - 0.3 * 0.3, 1e-3);
}

TEST(LoopMarginsTest, RefusesByNameWhatTheTheoryDoesNotHoldFor) {
  const auto refusal = [](const std::vector<std::string>& set) -> std::string {
    try {
      const Scenario scenario = paper(set);
      refuse_margin_obstacles(scenario);
      const StraightLoop loop(scenario);
    } catch (const UsageError& error) {
      return error.what();
    }
    return "";
  };
  using testing::HasSubstr;
  EXPECT_THAT(refusal({"controller.law=pid"}),
              HasSubstr("controller.v.i, .v.d, .omega.i, .omega.d"));
  EXPECT_THAT(refusal({"controller.trigger=timer"}), HasSubstr("controller.trigger"));
  EXPECT_THAT(refusal({"controller.pose_timeout_s=0.4"}), HasSubstr("controller.pose_timeout_s"));
  EXPECT_THAT(refusal({"sensor.send=changed"}), HasSubstr("sensor.send"));
  EXPECT_THAT(refusal({"channel.uplink.jitter.law=gamma", "channel.uplink.jitter.mean_ms=20",
                       "channel.uplink.jitter.sd_ms=10"}),
              HasSubstr("channel.uplink.jitter"));
  EXPECT_THAT(refusal({"channel.downlink.model=markov", "channel.downlink.markov.bad.delay_ms=50"}),
              HasSubstr("channel.downlink.model = \"markov\": must have one delay"));
  EXPECT_THAT(refusal({"channel.model=chain", "channel.chain.prr=[1.0, 0.0]",
                       "channel.chain.probabilities=[[0.9, 0.1], [0.5, 0.5]]",
                       "channel.chain.step_s=0.03"}),
              HasSubstr("channel.uplink.chain.step_s = 0.03"));
  EXPECT_THAT(refusal({"vehicle.actuator_lag_ms=50"}), HasSubstr("vehicle.radius_error"));
  const auto planned = [&](const std::string& law, const std::string& more) {
    return refusal({"controller.law=" + law, "actuator.policy=horizon", more});
  };
  EXPECT_EQ(planned("predictive", "sensor.rate_hz=20"), "");
  EXPECT_EQ(planned("predictive_consistent", "channel.prr=0.3"), "");
  EXPECT_THAT(planned("predictive", "sensor.rate_hz=12.5"), HasSubstr("controller.plan_step_ms"));
  EXPECT_THAT(planned("predictive", "channel.delay_ms=10"), HasSubstr("delays must be 0"));
  EXPECT_THAT(planned("predictive", "channel.prr=0"), HasSubstr("controller.horizon_s"));
  EXPECT_THAT(planned("mpc", "sensor.rate_hz=20"),
              testing::AllOf(HasSubstr("controller.law"), HasSubstr("actuator.policy")));
  const std::vector<std::string> late{"channel.uplink.delay_ms=200", "sensor.rate_hz=20"};
  EXPECT_EQ(refusal({late[0], late[1], "channel.uplink.queue_limit=5"}), "");
  EXPECT_THAT(refusal({late[0], late[1], "channel.uplink.queue_limit=4"}),
              HasSubstr("channel.uplink.queue_limit"));
  EXPECT_THAT(refusal({"controller.v.limit=2.8"}), HasSubstr("controller.v.limit"));
  EXPECT_THAT(refusal({"vehicle.max_wheel_speed_mps=2.8"}),
              HasSubstr("vehicle.max_wheel_speed_mps"));
  EXPECT_EQ(refusal({}), "");
}

}  // namespace
}  // namespace tether
