#include "tools/margin/survival.hpp"

#include <algorithm>
#include <boost/random/normal_distribution.hpp>
#include <cmath>
#include <deque>
#include <memory>

#include "common/scenario/run_settings.hpp"
#include "controller/laws/pid_law.hpp"
#include "controller/laws/tracking_law.hpp"
#include "sim/plant/kinematic_vehicle.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "tools/margin/loss_chain.hpp"
#include "tools/margin/mean_square.hpp"
#include "tools/margin/straight_loop.hpp"

namespace tether {
namespace {

/// Along x from the origin, for ever.
class Straight : public ReferencePath {
 public:
  explicit Straight(double v_mps) : v_mps_(v_mps) {}
  PathPoint at(double t_s) const override { return {v_mps_ * t_s, 0.0, 0.0, v_mps_, 0.0}; }

 private:
  double v_mps_;
};

/// The scenario's law: a twist for each pose.
class Answer {
 public:
  explicit Answer(const Scenario& scenario, double v_mps)
      : path_(std::make_shared<Straight>(v_mps)),
        tracks_(scenario.get<ControllerSettings>().law == "tracking"),
        tracking_(scenario.get<ControllerSettings>(),
                  scenario.get<VehicleSettings>().max_wheel_acceleration_mps2),
        pid_(scenario.get<ControllerSettings>(), path_, 0.0) {}

  Twist to(const Pose2& pose, double t_s) {
    if (tracks_) return tracking_.command(pose, path_->at(t_s));
    return pid_.step(pose, kStart + from_seconds(t_s));
  }

 private:
  std::shared_ptr<const ReferencePath> path_;
  bool tracks_;
  TrackingFeedback tracking_;
  PidLaw pid_;
};

/// One vehicle from its start on the path; times are in steps of its plant.
class Drive {
 public:
  Drive(const Scenario& scenario, const StraightLoop& loop, LossWalk& losses, RandomEngine& random)
      : loop_(loop),
        losses_(losses),
        random_(random),
        vehicle_(on_straight(scenario)),
        answer_(scenario, loop.v_mps),
        step_(step_of(scenario.get<WorldSettings>())),
        agv_(vehicle_, boundless(), step_) {}

  /// Returns the distance to the path's point at the end of the next period.
  double next_period_m() {
    const double now_s = time_s(steps(static_cast<double>(periods_) * loop_.timing.period_s));
    const Pose2 is = agv_.state().pose;
    const Pose2 seen{is.x_m + loop_.noise.position_m * normal_(random_),
                     is.y_m + loop_.noise.position_m * normal_(random_),
                     is.yaw_rad + loop_.noise.yaw_rad * normal_(random_)};
    if (losses_.step() == LossChain::kReceived) {
      under_way_.push_back({steps(now_s + loop_.timing.total_s()),
                            answer_.to(seen, now_s + loop_.timing.pose_delay_s)});
    }
    ++periods_;
    const std::int64_t end = steps(static_cast<double>(periods_) * loop_.timing.period_s);
    for (; !under_way_.empty() && under_way_.front().at < end; under_way_.pop_front()) {
      advance(under_way_.front().at);
      agv_.set_wheel_targets(to_wheel_speeds(under_way_.front().twist, vehicle_.track_m));
    }
    advance(end);
    const Position at = agv_.position();
    return std::hypot(at.x_m - loop_.v_mps * time_s(end), at.y_m);
  }

 private:
  struct Command {
    std::int64_t at;
    Twist twist;
  };

  static VehicleSettings on_straight(const Scenario& scenario) {
    VehicleSettings vehicle = scenario.get<VehicleSettings>();
    vehicle.start_x_m = vehicle.start_y_m = vehicle.start_yaw_rad = 0.0;
    return vehicle;
  }

  static WorldSettings boundless() {
    WorldSettings world;
    world.half_extent_m = 1e8;
    return world;
  }

  std::int64_t steps(double s) const { return std::llround(s / to_seconds(step_)); }
  double time_s(std::int64_t at) const { return static_cast<double>(at) * to_seconds(step_); }

  void advance(std::int64_t to) {
    while (now_ < to) now_ += agv_.take(to - now_, kStart + now_ * step_).taken;
  }

  const StraightLoop& loop_;
  LossWalk& losses_;
  RandomEngine& random_;
  boost::random::normal_distribution<double> normal_;
  VehicleSettings vehicle_;
  Answer answer_;
  Duration step_;
  KinematicVehicle agv_;
  std::deque<Command> under_way_;
  std::size_t periods_ = 0;
  std::int64_t now_ = 0;
};

}  // namespace

std::optional<FirstExcursion> first_excursion(const Scenario& scenario,
                                              const SurvivalTrial& trial) {
  constexpr double kLongest_s = 3600.0;
  const StraightLoop loop(scenario);
  if (loop.plans() || !is_white(scenario.get<SensorSettings>())) return std::nullopt;
  const LossChain chain = loop.chain();
  LossWalk losses(chain, random_stream(trial.seed, "margin/survival losses"));
  RandomEngine noise = random_stream(trial.seed, "margin/survival noise");
  FirstExcursion result;
  result.beyond_m = scenario.get<RunSettings>().lost_beyond_m;
  const double period_s = loop.timing.period_s;
  std::size_t periods = 0;
  while (periods < trial.most_periods && result.excursions < trial.most_excursions) {
    Drive drive(scenario, loop, losses, noise);
    bool away = false;
    double driven_s = 0.0;
    while (!away && driven_s < kLongest_s && periods++ < trial.most_periods) {
      driven_s += period_s;
      away = drive.next_period_m() > result.beyond_m && driven_s > kSurvivalSettling_s;
      if (driven_s > kSurvivalSettling_s) result.driven_s += period_s;
    }
    result.excursions += away ? 1 : 0;
  }
  result.mean_s = mean_time_interval(static_cast<double>(result.excursions), result.driven_s, 0.95);
  return result;
}

Critical almost_sure_prr(const Scenario& scenario) {
  const StraightLoop loop(scenario);
  if (loop.plans()) return {Critical::Kind::always, 0.0};
  const LoopStep across = part_of(loop.step(loop.timing), LoopPart::across);
  const LoopStep along = part_of(loop.step(loop.timing), LoopPart::along);
  return critical_value(
      [&](double prr) {
        const LossChain chain =
            both_links(ChainLink::independent(prr), ChainLink::independent(prr));
        return std::max(almost_sure_growth(chain, {across}), almost_sure_growth(chain, {along}));
      },
      0.01, 1.0, 1e-4);
}

}  // namespace tether
