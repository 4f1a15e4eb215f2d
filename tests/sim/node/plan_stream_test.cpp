#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <numeric>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "common/vehicle/actuator.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "sim/plant/plant.hpp"
#include "tests/common/actuator/plan_rig.hpp"

// Whatever plans and commands arrive, in whatever order and time: the vehicle's motion is finite
// and within its limits, and every plan is counted once. Which plan is followed, and when, is the
// matter of plan_buffer_test, plan_order_test and actuator_test.

namespace tether {
namespace {

using std::chrono::milliseconds;
using test::plan;

/// Valid and hostile input from a seed.
class Hostile {
 public:
  explicit Hostile(unsigned seed) : random_(seed) {}

  bool one_in(unsigned n) { return random_() % n == 0; }
  std::int64_t below(std::int64_t n) {
    return static_cast<std::int64_t>(random_() % static_cast<std::uint32_t>(n));
  }
  double number() { return std::uniform_real_distribution<double>(-1.0, 1.0)(random_); }

  Twist usable_twist() {
    const double scale = one_in(5) ? 9e8 : one_in(3) ? 30.0 : 3.0;
    return {scale * number(), scale * number()};
  }

  Plan next(Instant now) {
    Plan p = plan(now + milliseconds{below(3000) - 1500}, next_id_++);
    p.stamp = now + milliseconds{below(100) - 99};
    p.seq = seq_++;
    p.based_on = p.based_on_last = one_in(2) ? Plan::kBasedOnAny : next_id_ - below(4) - 1;
    if (p.based_on >= 0) p.based_on_last += below(4);
    p.settled = now + milliseconds{below(2000) - 1000};
    p.name.session = session_;
    p.step = milliseconds{1 + below(200)};
    p.twists.resize(static_cast<std::size_t>(1 + below(60)));
    for (Twist& twist : p.twists) twist = usable_twist();
    if (train_ == 0 && one_in(100)) {
      train_ = 40;
      session_ = next_session_++;
    }
    if (train_ > 0) {  // more than may wait, each behind the one before
      p.name.session = session_;
      p.based_on = p.based_on_last = Plan::kBasedOnAny;
      p.stamp = now + milliseconds{990};
      p.start = now + milliseconds{1000 + 50 * (40 - train_--)};
    } else if (one_in(3)) {
      damage(p, now);
    }
    return p;
  }

 private:
  void damage(Plan& p, Instant now) {
    constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
    constexpr double kInf = std::numeric_limits<double>::infinity();
    constexpr std::int64_t kExtremes[] = {INT64_MIN, -2, -1, 0, 1, INT64_MAX - 1, INT64_MAX};
    const std::int64_t extreme = kExtremes[below(7)];
    Twist& twist = p.twists[static_cast<std::size_t>(below(std::ssize(p.twists)))];
    switch (below(16)) {
      case 0:
        twist.v_mps = one_in(2) ? kNaN : kInf;
        break;
      case 1:
        twist.omega_radps = one_in(2) ? -kInf : double{1e38F};
        break;
      case 2:
        p.step = milliseconds{-below(100)};
        break;
      case 3:
        p.step = std::chrono::microseconds{INT32_MAX};
        break;
      case 4:
        p.twists.clear();
        break;
      case 5:
        p.twists.resize(8000);
        break;
      case 6:
        p.start = from_utime(extreme);
        break;
      case 7:
        p.start = now + std::chrono::seconds{below(40) - 20};
        break;
      case 8:
        p.stamp = from_utime(extreme);
        break;
      case 9:
        p.seq = extreme;
        break;
      case 10:
        p.name.session = one_in(2) ? session_ = below(8) : extreme;
        break;
      case 11:
        p.name.id = extreme;
        break;
      case 12:
        p.based_on = extreme;
        break;
      case 13:
        p.based_on_last = extreme;
        break;
      case 14:
        p.settled = from_utime(extreme);
        break;
      default:
        p.name.id = below(next_id_ + 1);
        break;  // again
    }
  }

  std::mt19937 random_;
  std::int64_t next_id_ = 0;
  std::int64_t seq_ = 0;
  std::int64_t train_ = 0;
  std::int64_t session_ = 3;
  std::int64_t next_session_ = 100;
};

constexpr auto kKinematic = VehicleSettings::Plant::kinematic;
constexpr auto kOde = VehicleSettings::Plant::ode;

struct Case {
  VehicleSettings::Plant plant;
  const char* policy;
  int seeds;
  int seconds;
};
void PrintTo(const Case& c, std::ostream* out) {
  *out << (c.plant == kOde ? "ode " : "kinematic ") << c.policy;
}

class RandomStreams : public ::testing::TestWithParam<Case> {
 protected:
  static constexpr Duration kStep = milliseconds{1};

  /// One run; what must hold is checked in every step.
  void drive(unsigned seed) {
    Hostile hostile(seed);
    Scenario scenario;
    scenario.get<VehicleSettings>().plant = GetParam().plant;
    scenario.get<ActuatorSettings>().policy = GetParam().policy;
    scenario.get<ActuatorSettings>().timeout_s = 0.3;
    const auto vehicle =
        make_plant(scenario.get<VehicleSettings>(), scenario.get<WorldSettings>(), kStep);
    Actuator actuator(scenario.get<ActuatorSettings>(), scenario.get<VehicleSettings>(),
                      {.earliest = kStart});
    last_ = {};
    for (Instant now = kStart; now < kStart + std::chrono::seconds{GetParam().seconds};
         now += kStep) {
      if (hostile.one_in(20)) offer(actuator, now, hostile);
      if (hostile.one_in(2000)) actuator.on_command(now, hostile.usable_twist());
      const Twist twist = actuator.in_force(now);
      ASSERT_TRUE(is_usable(twist)) << to_seconds(now);
      vehicle->set_wheel_targets(to_wheel_speeds(twist, scenario.get<VehicleSettings>().track_m));
      vehicle->step();
      check_motion(*vehicle, scenario.get<VehicleSettings>());
      if (HasFatalFailure()) return;
    }
    if (GetParam().policy == std::string("horizon")) check_balance(actuator);
  }

 private:
  void offer(Actuator& actuator, Instant now, Hostile& hostile) {
    Plan p = hostile.next(now);
    const auto source = hostile.one_in(10) ? PlanSource::preload : PlanSource::network;
    const PlanName name = p.name;
    const bool copy = hostile.one_in(5);
    const Plan again = copy ? p : Plan{};
    ++offered_;
    if (actuator.on_plan(now, source, std::move(p))) {
      ++accepted_;
      ASSERT_EQ(actuator.plan(), name);
    }
    if (!copy) return;
    ++offered_;
    ASSERT_FALSE(actuator.on_plan(now, source, again)) << "the same packet again";
  }

  void check_motion(const Plant& vehicle, const VehicleConfig& config) {
    // The servos' targets are limited to the bit, wheels that turn with inertia follow them.
    const WheelSpeeds& target = vehicle.servo_targets();
    const double step_mps = config.max_wheel_acceleration_mps2 * to_seconds(kStep) + 1e-9;
    ASSERT_LE(std::abs(target.left_mps - last_.left_mps), step_mps);
    ASSERT_LE(std::abs(target.right_mps - last_.right_mps), step_mps);
    ASSERT_LE(std::abs(target.left_mps), config.max_wheel_speed_mps + 1e-9);
    ASSERT_LE(std::abs(target.right_mps), config.max_wheel_speed_mps + 1e-9);
    last_ = target;
    const VehicleState& state = vehicle.state();
    ASSERT_TRUE(is_usable(state.pose) && is_usable(state.twist));
    ASSERT_LT(std::abs(state.rim_speeds.left_mps), config.max_wheel_speed_mps + 0.5);
    ASSERT_LT(std::abs(state.rim_speeds.right_mps), config.max_wheel_speed_mps + 0.5);
  }

  void check_balance(const Actuator& actuator) {
    CounterList list;
    actuator.list(list);
    std::int64_t sum = 0;
    for (const auto& [name, value] : list) {
      EXPECT_GE(value, 0) << name;
      const bool is_fate =
          name != "plan.received" && name != "plan.missed" && name != "plan.sessions";
      sum += is_fate ? value : 0;
      seen_[name] = std::max(seen_[name], value);
    }
    const std::map<std::string, std::int64_t> counters(list.begin(), list.end());
    EXPECT_EQ(counters.at("plan.received"), offered_);
    EXPECT_EQ(counters.at("plan.accepted"), accepted_);
    EXPECT_EQ(sum, offered_);
    offered_ = accepted_ = 0;
  }

 protected:
  std::map<std::string, std::int64_t> seen_;

 private:
  WheelSpeeds last_;
  std::int64_t offered_ = 0;
  std::int64_t accepted_ = 0;
};

TEST_P(RandomStreams, LeaveTheMotionWithinTheVehiclesLimits) {
  for (int seed = 1; seed <= GetParam().seeds; ++seed) {
    drive(static_cast<unsigned>(seed));
    ASSERT_FALSE(HasFatalFailure()) << "seed " << seed;
  }
  if (GetParam().plant != kKinematic) return;
  // The streams are hostile enough only if they meet every reason but those of a bridge.
  const std::set<std::string> of_bridges{"plan.before_stop", "plan.without_pose", "plan.older_pose",
                                         "plan.blind"};
  for (const auto& [name, count] : seen_) {
    EXPECT_EQ(count > 0, !of_bridges.contains(name)) << name;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Plans, RandomStreams,
    ::testing::Values(Case{kKinematic, "horizon", 60, 20}, Case{kKinematic, "hold", 5, 20},
                      Case{kKinematic, "zero", 5, 20}, Case{kKinematic, "ramp", 5, 20},
                      Case{kKinematic, "decay", 5, 20}, Case{kOde, "horizon", 10, 10}));

}  // namespace
}  // namespace tether
