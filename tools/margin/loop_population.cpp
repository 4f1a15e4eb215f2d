#include "tools/margin/loop_population.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

#include "common/base/random.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "margin/loop/straight_loop.hpp"
#include "netem/channel/change.hpp"
#include "netem/channel/models.hpp"
#include "netem/channel/use.hpp"
#include "netem/models/kinds.hpp"
#include "netem/relay/netem_node.hpp"
#include "netem/stages/kinds.hpp"
#include "sim/node/sim_node.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "tools/loop/closed_loop.hpp"

namespace tether {
namespace {

constexpr double kSmallAlong_m = 1e-7;  // when losses begin; else speeds, and so gains, vary
constexpr double kMiddle_m = 1e-10;     // across, half way in logarithms
constexpr std::size_t kStage = 5;       // periods between two draws
constexpr std::size_t kSettlingStages = 24;

/// When the path has its full speed.
double full_speed_s(const ReferencePath& path, double v_mps) {
  double t_s = 0.0;
  while (path.at(t_s).v_mps < v_mps * (1.0 - 1e-9)) t_s += 0.05;
  return t_s;
}

/// Until 1 m has shrunk to `left_m`, if squares grow like this; or long enough to notice it.
double periods_until(double left_m, double radius) {
  constexpr double kMost = 1000.0;
  return radius < 1.0 ? std::min(kMost, std::ceil(2.0 * std::log(left_m) / std::log(radius)))
                      : kMost;
}

/// Without noise, and without losses until they are given.
Scenario quiet(const Scenario& given) {
  Scenario scenario = given;
  scenario.get<VehicleSettings>().start_error_m = 0.0;
  scenario.get<VehicleSettings>().start_error_rad = 0.0;
  auto& sensor = scenario.get<SensorSettings>();
  SensorSettings clean;
  clean.rate_hz = sensor.rate_hz;
  clean.latency_ms = sensor.latency_ms;
  sensor = clean;
  auto& channel = scenario.get<ChannelSettings>();
  const auto perfect = [](const LinkConfig& link) {
    LinkConfig with_delay;
    with_delay.fixed.delay_ms = 1e3 * only_delay_s(link);
    return with_delay;
  };
  channel.uplink = perfect(channel.uplink);
  channel.downlink = perfect(channel.downlink);
  channel.shared_state = false;
  return scenario;
}

/// State that all loops of a population share.
struct Common {
  Scenario scenario;      ///< without losses
  NetemSettings network;  ///< with them
  PathPoint start;
  double v_mps, period_s, crossover_radps, turn_m;
  double from_s;  ///< start of the first stage, between two poses

  Common(const Scenario& given, double more_loss, std::size_t stages)
      : scenario(quiet(given)),
        network(given),
        start(make_path(given.get<PathSettings>())->at(0.0)) {
    auto& channel = network.get<ChannelSettings>();
    if (more_loss > 0.0) {
      channel = change_channel(channel, {fmt::format("loss={}", more_loss)}).channel;
    }
    const StraightLoop loop(scenario);
    v_mps = loop.v_mps;
    period_s = loop.timing.period_s;
    crossover_radps = loop.steering.crossover_radps();
    turn_m = v_mps / crossover_radps;  // turn of a radian, as it swings
    const double speed_s = full_speed_s(*make_path(given.get<PathSettings>()), v_mps);
    const double settling =
        periods_until(kSmallAlong_m, loop.radius(loop.chain(), LoopPart::along));
    from_s = (std::ceil(speed_s / period_s) + settling + 0.5) * period_s;
    const StraightLoop lossy(given);
    const double growth = 0.5 * std::log(lossy.radius(lossy.chain(more_loss), LoopPart::across)) *
                          static_cast<double>(stages * kStage);
    const double begin_m = std::clamp(kMiddle_m * std::exp(-0.5 * growth), 1e-12, 1e-3);
    start_beside(begin_m * std::pow(loop.radius(loop.chain(), LoopPart::across), -0.5 * settling));
    auto& run = scenario.get<RunSettings>();
    run.duration_s = end_s(stages) + period_s;
    run.truth_rate_hz = 1.0 / run.duration_s;
    run.report_period_s = run.duration_s;
    auto& path = scenario.get<PathSettings>();
    constexpr double kBraking_m = 5.0;
    if (path.kind == "line") path.length_m = v_mps * run.duration_s + kBraking_m;  // no more
  }

  void start_beside(double by_m) {
    constexpr double kMost_m = 0.1;
    const double beside_m = std::min(by_m, kMost_m);
    auto& vehicle = scenario.get<VehicleSettings>();
    vehicle.start_x_m = start.x_m - beside_m * std::sin(start.yaw_rad);
    vehicle.start_y_m = start.y_m + beside_m * std::cos(start.yaw_rad);
    vehicle.start_yaw_rad = start.yaw_rad;
  }

  double end_s(std::size_t stages) const {
    return from_s + static_cast<double>(stages * kStage) * period_s;
  }

  double square_m2(const VehicleState& state) const {
    const Pose2& pose = state.pose;
    const double across_m = std::cos(start.yaw_rad) * (pose.y_m - start.y_m) -
                            std::sin(start.yaw_rad) * (pose.x_m - start.x_m);
    const double turned_m = turn_m * wrap_angle(pose.yaw_rad - start.yaw_rad);
    const double turning_m = turn_m / crossover_radps * state.twist.omega_radps;
    return across_m * across_m + turned_m * turned_m + turning_m * turning_m;
  }
};

/// A model with other luck from now on that is in this state; null if it is not there now.
ProcessPtr in_state(ProcessPtr process, int state, ChannelModelKind::Moves moves, Instant now) {
  constexpr int kLongest = 1'000'000;
  if (moves == ChannelModelKind::Moves::per_packet) {
    for (int i = 0; i < kLongest && process->state() != state; ++i) process->on_packet(now);
  }
  return process->state() == state ? process : nullptr;
}

/// From now on, both links meet the luck of another seed; in the states that they are in, unless
/// their losses are to begin.
void change_luck(ClosedLoop& loop, NetemSettings settings, std::uint64_t seed, bool begins) {
  constexpr std::uint64_t kMostTries = 100'000;
  const Instant now = loop.loop().now();
  const auto& channel = settings.get<ChannelSettings>();
  Link &up = loop.netem().uplink(), &down = loop.netem().downlink();
  ProcessPtr new_up, new_down;
  const auto take = [&](ProcessPtr& to, const ProcessPtr& from, const LinkConfig& link, Link& is) {
    if (to) return;
    from->advance(now);
    is.process().advance(now);
    to = begins ? from : in_state(from, is.process().state(), kind_of(link).moves(link), now);
  };
  for (std::uint64_t i = 0; !new_up || !new_down; ++i) {
    if (i == kMostTries) throw std::runtime_error("margin: a channel's state is too rare to copy");
    settings.get<RunSettings>().seed = split_mix(seed + i);
    const ChannelModels models = make_models(settings);
    if (channel.shared_state) new_up = new_down = nullptr;
    take(new_up, models.uplink, channel.uplink, up);
    take(new_down, models.downlink, channel.downlink, down);
  }
  up.apply(make_stages(channel.uplink, link_key("uplink"), link_streams(settings, "uplink")),
           new_up);
  down.apply(
      make_stages(channel.downlink, link_key("downlink"), link_streams(settings, "downlink")),
      new_down);
}

class WholeLoop {
 public:
  WholeLoop(const Common& common, std::uint64_t seed)
      : common_(&common), loop_(std::make_unique<ClosedLoop>(common.scenario)) {
    meet({0, seed});
  }

  /// One with the same past, at the end of `stage`, and another future.
  WholeLoop copy(std::size_t stage, std::uint64_t seed) const {
    WholeLoop other(*common_, luck_.front().seed);
    for (std::size_t i = 1; i < luck_.size(); ++i) other.meet(luck_[i]);
    other.meet({stage, seed});
    if (other.now_m2() != square_m2_) throw std::logic_error("a loop's copy is not like it");
    other.square_m2_ = square_m2_;
    return other;
  }

  /// Runs to the end of a stage: by how much the square has grown since the last one.
  double grow(std::size_t stage) {
    run_to(stage);
    const double before_m2 = square_m2_;
    square_m2_ = now_m2();
    return before_m2 > 0.0 ? square_m2_ / before_m2 : 0.0;
  }

  double square_m2() const { return square_m2_; }
  double speed_mps() const { return state().twist.v_mps; }

 private:
  struct Luck {
    std::size_t from_stage;
    std::uint64_t seed;
  };

  VehicleState state() const { return loop_->sim().vehicle().state(); }
  double now_m2() const { return common_->square_m2(state()); }

  void run_to(std::size_t stage) { loop_->run_until(kStart + from_seconds(common_->end_s(stage))); }

  void meet(const Luck& luck) {
    run_to(luck.from_stage);
    change_luck(*loop_, common_->network, luck.seed, luck_.empty());
    luck_.push_back(luck);
  }

  const Common* common_;
  std::vector<Luck> luck_;
  std::unique_ptr<ClosedLoop> loop_;
  double square_m2_ = 0.0;
};

/// Each as often as its weight says, to less than one (systematic resampling).
std::vector<WholeLoop> drawn_by_weight(std::vector<WholeLoop> loops,
                                       const std::vector<double>& weights, double sum,
                                       std::size_t stage, RandomEngine& random) {
  std::vector<WholeLoop> result;
  result.reserve(loops.size());
  const double each = sum / static_cast<double>(loops.size());
  double at = each * uniform_01(random), passed = 0.0;
  for (std::size_t i = 0; i < loops.size(); ++i) {
    passed += weights[i];
    std::size_t times = 0;
    for (; at < passed && result.size() + times < loops.size(); at += each) ++times;
    for (std::size_t k = 1; k < times; ++k) result.push_back(loops[i].copy(stage, random()));
    if (times > 0) result.push_back(std::move(loops[i]));
  }
  return result;
}

/// Slope of the line of least squares through y(0), y(1) …: swings of the loop matter less than in
/// a difference.
double slope(const std::vector<double>& y) {
  const double middle = 0.5 * static_cast<double>(y.size() - 1);
  double xy = 0.0, xx = 0.0;
  for (std::size_t i = 0; i < y.size(); ++i) {
    const double x = static_cast<double>(i) - middle;
    xy += x * y[i];
    xx += x * x;
  }
  return xy / xx;
}

}  // namespace

std::string why_no_trial(const Scenario& scenario) {
  const StraightLoop loop(scenario);
  if (loop.v_mps - loop.least_mps > 1e-6) {
    return fmt::format(
        "the path's speed varies, from {:.2f} to {:.2f} m/s: there is no single critical value",
        loop.least_mps, loop.v_mps);
  }
  const auto path = make_path(scenario.get<PathSettings>());
  const double end_s = scenario.get<RunSettings>().duration_s;
  for (int i = 0; i <= 1000; ++i) {
    if (path->at(end_s * i / 1000).omega_radps != 0.0) return "the path has curves";
  }
  return "";
}

PopulationGrowth whole_loop_growth(const Scenario& scenario, double more_loss,
                                   const PopulationTrial& trial) {
  const std::size_t stages = kSettlingStages + (trial.periods + kStage - 1) / kStage;
  const Common common(scenario, more_loss, stages);
  RandomEngine random = random_stream(trial.seed, "margin/loop population");
  const bool lossless = StraightLoop(scenario).chain(more_loss).prr() == 1.0;
  std::vector<WholeLoop> loops;
  for (std::size_t i = 0; i < (lossless ? 1 : trial.loops); ++i)
    loops.emplace_back(common, random());
  for (WholeLoop& loop : loops) loop.grow(0);
  PopulationGrowth growth;
  std::vector<double> logs{0.0}, weights(loops.size());
  for (std::size_t stage = 1; stage <= stages; ++stage) {
    double sum = 0.0;
    for (std::size_t i = 0; i < loops.size(); ++i) {
      sum += weights[i] = loops[i].grow(stage);
      growth.largest_m = std::max(growth.largest_m, std::sqrt(loops[i].square_m2()));
      growth.speed_off =
          std::max(growth.speed_off, std::abs(loops[i].speed_mps() / common.v_mps - 1.0));
    }
    if (!(sum > 0.0)) {
      growth.log_radius = -std::numeric_limits<double>::infinity();
      return growth;
    }
    const auto n = static_cast<double>(loops.size());
    if (stage > kSettlingStages) logs.push_back(logs.back() + std::log(sum / n));
    if (stage < stages) {
      loops = drawn_by_weight(std::move(loops), weights, sum, stage, random);
      weights.resize(loops.size());
    }
  }
  growth.log_radius = slope(logs) / static_cast<double>(kStage);
  return growth;
}

}  // namespace tether
