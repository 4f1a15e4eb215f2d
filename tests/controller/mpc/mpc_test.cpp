#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "controller/laws/mpc_planner.hpp"
#include "tests/controller/laws/laws_rig.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::LawRig;
using test::with_law;

/// H = AᵀA + I of a random A; the box is narrow enough for some bounds to be active.
BoxQp random_qp(unsigned seed, std::size_t n, double box) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<double> a(n * n);
  for (double& x : a) x = normal(random);
  BoxQp qp{std::vector<double>(n * n), std::vector<double>(n), std::vector<double>(n, -box),
           std::vector<double>(n, box)};
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) {
      for (std::size_t k = 0; k < n; ++k) qp.hessian[i * n + j] += a[k * n + i] * a[k * n + j];
    }
    qp.hessian[i * n + i] += 1.0;
    qp.gradient[i] = 3.0 * normal(random);
  }
  return qp;
}

/// How far x is from fulfilling the conditions of Karush, Kuhn and Tucker: the gradient, where no
/// bound holds against it.
double kkt_violation(const BoxQp& qp, const std::vector<double>& x) {
  double worst = 0.0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    double slope = qp.gradient[i];
    for (std::size_t j = 0; j < x.size(); ++j) slope += qp.hessian[i * x.size() + j] * x[j];
    const bool held = (x[i] <= qp.lower[i] && slope > 0.0) || (x[i] >= qp.upper[i] && slope < 0.0);
    if (!held) worst = std::max(worst, std::abs(slope));
  }
  return worst;
}

TEST(BoxQp, FulfilsTheConditionsOfKarushKuhnAndTucker) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const BoxQp qp = random_qp(seed, 20, 0.2);
    const auto x = solve(qp, std::vector<double>(20, 0.0));
    ASSERT_TRUE(x);
    const auto at_bound =
        std::count_if(x->begin(), x->end(), [](double xi) { return std::abs(xi) == 0.2; });
    EXPECT_GT(at_bound, 0) << "the test would not see bounds";
    EXPECT_LT(kkt_violation(qp, *x), 0.02) << "of slopes of about 3";
  }
}

TEST(BoxQp, WithoutActiveBoundsTheSlopeIsZero) {
  const BoxQp qp = random_qp(3, 10, 1e3);
  const auto x = solve(qp, std::vector<double>(10, 0.0));
  ASSERT_TRUE(x);
  EXPECT_LT(kkt_violation(qp, *x), 1e-3);
}

/// A vehicle that drives with the path of the eight, beside it; the guess is the path's own twists.
struct PlannerRig {
  static constexpr double kStart_s = 12.0, kStep_s = 0.15;
  std::shared_ptr<const ReferencePath> path = LawRig(with_law("mpc")).path;
  MotionModel model{{}};
  MpcSettings settings;

  MotionModel::State beside(double left_m) const {
    const PathPoint p = path->at(kStart_s);
    return {{p.x_m - left_m * std::sin(p.yaw_rad), p.y_m + left_m * std::cos(p.yaw_rad), p.yaw_rad},
            model.rim_of({p.v_mps, p.omega_radps})};
  }
  std::vector<Twist> guess() const {
    std::vector<Twist> twists;
    for (int k = 1; k <= 40; ++k) {
      const PathPoint p = path->at(kStart_s + k * kStep_s);
      twists.push_back({p.v_mps, p.omega_radps});
    }
    return twists;
  }
  double mean_error_m(MotionModel::State state, const std::vector<Twist>& twists) const {
    double sum_m = 0.0;
    for (std::size_t k = 0; k < twists.size(); ++k) {
      model.advance(state, twists[k], kStep_s);
      const PathPoint p = path->at(kStart_s + static_cast<double>(k + 1) * kStep_s);
      sum_m += std::hypot(state.pose.x_m - p.x_m, state.pose.y_m - p.y_m);
    }
    return sum_m / static_cast<double>(twists.size());
  }
  std::vector<Twist> improved(const MotionModel::State& from) const {
    return MpcPlanner(settings, path).improve(model, from, kStart_s, kStep_s, guess());
  }
};

TEST(MpcPlanner, BringsAVehicleBesideThePathBackToIt) {
  const PlannerRig rig;
  const auto from = rig.beside(0.3);
  EXPECT_GT(rig.mean_error_m(from, rig.guess()), 0.29) << "the path's own twists keep it beside";
  EXPECT_LT(rig.mean_error_m(from, rig.improved(from)), 0.1);
}

TEST(MpcPlanner, NoChangeOfARimIsBeyondTheWheelsAcceleration) {
  const PlannerRig rig;
  const double most_mps = 3.0 * PlannerRig::kStep_s;
  bool at_limit = false;
  for (const double left_m : {-0.9, -0.3, 0.3, 0.9}) {
    const auto from = rig.beside(left_m);
    WheelSpeeds before = from.rim;
    for (const Twist& twist : rig.improved(from)) {
      const WheelSpeeds rim = rig.model.rim_of(twist);
      for (const double change_mps :
           {rim.left_mps - before.left_mps, rim.right_mps - before.right_mps}) {
        EXPECT_LE(std::abs(change_mps), most_mps + 1e-9);
        at_limit = at_limit || std::abs(change_mps) > 0.999 * most_mps;
      }
      before = rim;
    }
  }
  EXPECT_TRUE(at_limit) << "the test would not see the limit";
}

TEST(MpcPlanner, OnThePathItLeavesThePathsOwnTwists) {
  const PlannerRig rig;
  const auto guess = rig.guess();
  const auto improved = rig.improved(rig.beside(0.0));
  ASSERT_EQ(improved.size(), guess.size());
  for (std::size_t k = 0; k < guess.size(); ++k) {
    EXPECT_NEAR(improved[k].v_mps, guess[k].v_mps, 0.02);
    EXPECT_NEAR(improved[k].omega_radps, guess[k].omega_radps, 0.02);
  }
}

TEST(MpcPlanner, FartherOffThanWithinItLeavesThePlanToTheRollOut) {
  const PlannerRig rig;
  EXPECT_FALSE(rig.improved(rig.beside(0.99)).empty());
  EXPECT_TRUE(rig.improved(rig.beside(1.01)).empty());
}

TEST(MpcPlanner, IsDeterministic) {
  const PlannerRig rig;
  const auto once = rig.improved(rig.beside(0.3)), again = rig.improved(rig.beside(0.3));
  ASSERT_EQ(once.size(), again.size());
  for (std::size_t k = 0; k < once.size(); ++k) {
    EXPECT_EQ(once[k].v_mps, again[k].v_mps);
    EXPECT_EQ(once[k].omega_radps, again[k].omega_radps);
  }
}

}  // namespace
}  // namespace tether
