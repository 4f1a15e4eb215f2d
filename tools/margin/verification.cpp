#include "tools/margin/verification.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>
#include <vector>

#include "common/base/random.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "netem/channel/change.hpp"
#include "netem/channel/models.hpp"
#include "netem/channel/use.hpp"
#include "netem/models/kinds.hpp"
#include "netem/relay/netem_node.hpp"
#include "netem/stages/kinds.hpp"
#include "netem/statistics/estimate.hpp"
#include "sim/node/sim_node.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "tools/margin/design_search.hpp"
#include "tools/margin/loop_margins.hpp"
#include "tools/margin/parallel.hpp"
#include "tools/margin/straight_loop.hpp"
#include "tools/margin/survival.hpp"
#include "tools/nodes/closed_loop.hpp"

namespace tether {
namespace {

struct Loop {
  Eigen::VectorXd z;
  std::size_t state;
};

std::size_t draw(const std::vector<double>& probabilities, RandomEngine& random) {
  double luck = uniform_01(random);
  for (std::size_t i = 0; i + 1 < probabilities.size(); ++i) {
    luck -= probabilities[i];
    if (luck < 0.0) return i;
  }
  return probabilities.size() - 1;
}

/// Each as often as its weight says, to less than one (systematic resampling).
std::vector<Loop> resampled(const std::vector<Loop>& loops, const std::vector<double>& weights,
                            double sum, RandomEngine& random) {
  std::vector<Loop> result;
  result.reserve(loops.size());
  const double each = sum / static_cast<double>(loops.size());
  double at = each * uniform_01(random), passed = 0.0;
  for (std::size_t i = 0; i < loops.size(); ++i) {
    passed += weights[i];
    for (; at < passed && result.size() < loops.size(); at += each) {
      result.push_back({loops[i].z / std::sqrt(weights[i]), loops[i].state});
    }
  }
  while (result.size() < loops.size()) result.push_back(result.back());  // rounding
  return result;
}

}  // namespace

double simulated_radius(const LossChain& chain, const std::vector<LoopStep>& steps,
                        const LinearTrial& trial) {
  RandomEngine random = random_stream(trial.seed, "margin/linear trial");
  std::vector<std::vector<const LossChain::Jump*>> jumps(chain.states);
  std::vector<std::vector<double>> probabilities(chain.states);
  for (const auto& jump : chain.jumps) {
    jumps[jump.from].push_back(&jump);
    probabilities[jump.from].push_back(jump.probability);
  }
  const Eigen::Index n = steps.front().a[0].rows();
  std::vector<Loop> loops;
  for (std::size_t i = 0; i < trial.loops; ++i) {
    Eigen::VectorXd z(n);
    for (double& component : z) component = uniform_01(random) - 0.5;
    loops.push_back({z.normalized(), draw(chain.stationary, random)});
  }
  const std::size_t settling = trial.periods / 3;
  double log_growth = 0.0;
  std::vector<double> weights(trial.loops);
  for (std::size_t k = 0; k < trial.periods; ++k) {
    double sum = 0.0;
    for (std::size_t i = 0; i < trial.loops; ++i) {
      Loop& loop = loops[i];
      const auto& jump = *jumps[loop.state][draw(probabilities[loop.state], random)];
      loop.z = steps[k % steps.size()].a[jump.mode] * loop.z;
      loop.state = jump.to;
      weights[i] = loop.z.squaredNorm();
      sum += weights[i];
    }
    if (!(sum > 0.0)) return 0.0;
    if (k >= settling) log_growth += std::log(sum / static_cast<double>(trial.loops));
    loops = resampled(loops, weights, sum, random);
  }
  return std::exp(log_growth / static_cast<double>(trial.periods - settling));
}

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

namespace {

constexpr double kLinearBar = 0.05, kFullBar = 0.15;
constexpr double kSmall_m = 0.01;  // the law's terms of second order are below 1 % of the first's
constexpr double kSteady = 0.01;   // share of the speed, to which gains are in proportion
constexpr std::size_t kPoints = 3;
using Points = std::array<double, kPoints>;

/// Where the quadratic through the points passes 0, nearest to the middle one; nullopt if that is
/// farther off than the outermost ones.
std::optional<double> zero_of(const Points& x, const Points& y) {
  const double below = x[0] - x[1], above = x[2] - x[1];
  const double fall = (y[0] - y[1]) / below, rise = (y[2] - y[1]) / above;
  const double c2 = (rise - fall) / (above - below), c1 = fall - c2 * below, c0 = y[1];
  const double root = c1 * c1 - 4.0 * c0 * c2;
  if (!(root >= 0.0)) return std::nullopt;
  const double u = c0 / (-0.5 * (c1 + std::copysign(std::sqrt(root), c1)));  // the smaller one
  if (!(u >= below && u <= above)) return std::nullopt;
  return x[1] + u;
}

/// `log_radius(x, seed)`; nullopt if their mean has no zero. The interval is the jackknife's.
std::optional<SimulatedCritical> simulated_critical(
    const Points& x, const VerificationTrial& trial,
    const std::function<double(double, std::uint64_t)>& log_radius) {
  std::vector<Points> y(trial.seeds);
  for_each_index(trial.seeds * kPoints, trial.jobs, [&](std::size_t i) {
    y[i / kPoints][i % kPoints] = log_radius(x[i % kPoints], 1 + i / kPoints);
  });
  const auto zero_without = [&](std::size_t left_out) {
    Points sum{};
    for (std::size_t seed = 0; seed < trial.seeds; ++seed) {
      for (std::size_t i = 0; seed != left_out && i < kPoints; ++i) sum[i] += y[seed][i];
    }
    return zero_of(x, sum);
  };
  const auto all = zero_without(trial.seeds);
  if (!all) return std::nullopt;
  const auto n = static_cast<double>(trial.seeds);
  double squares = 0.0;
  for (std::size_t seed = 0; seed < trial.seeds; ++seed) {
    const auto one = zero_without(seed);
    if (!one) return std::nullopt;
    squares += (*one - *all) * (*one - *all);
  }
  const double half = student_quantile(0.95, n - 1.0) * std::sqrt(squares * (n - 1.0) / n);
  return SimulatedCritical{*all, *all - half, *all + half};
}

void raise(std::atomic<double>& largest, double to) {
  double seen = largest;
  while (to > seen && !largest.compare_exchange_weak(seen, to)) {
  }
}

Points around(double middle, double most) {
  return {(1.0 - kFullBar) * middle, middle, std::min(most, (1.0 + kFullBar) * middle)};
}

std::string why_none(const Critical& critical) {
  switch (critical.kind) {
    case Critical::Kind::always:
      return "stable in the whole range looked at";
    case Critical::Kind::never:
      return "unstable in the whole range looked at";
    default:
      return "stability comes and goes";
  }
}

class Verifier {
 public:
  Verifier(const Scenario& scenario, const VerificationTrial& trial)
      : scenario_(scenario),
        trial_(trial),
        loop_(scenario),
        why_not_full_(why_no_trial(scenario)) {}

  VerifiedCritical prr() const {
    VerifiedCritical row;
    const double own = loop_.prr_each_way();
    const auto more_loss = [&](double prr) { return std::max(0.0, 1.0 - prr / own); };
    const auto chain_of = [&](double prr) { return loop_.chain(more_loss(prr)); };
    const LoopStep step = part_of(loop_.step(loop_.timing), LoopPart::across);
    const Critical critical =
        critical_value([&](double prr) { return loop_.radius(chain_of(prr), LoopPart::across); },
                       0.01 * own, own, 1e-5);
    if (critical.kind != Critical::Kind::found) return without(row, why_none(critical));
    row.predicted = critical.value;
    const Points x = around(critical.value, own);
    row.linear = simulated_critical(x, trial_, [&](double prr, std::uint64_t seed) {
      return linear_growth(chain_of(prr), step, seed);
    });
    compare_full(row, x, [&](double prr, const PopulationTrial& trial) {
      return whole_loop_growth(scenario_, more_loss(prr), trial);
    });
    return row;
  }

  VerifiedCritical delay() const {
    VerifiedCritical row;
    row.quantity = VerifiedCritical::Quantity::delay;
    if (loop_.plans()) return without(row, "plans are of loops without delay");
    const LossChain chain = loop_.chain();
    const auto step = [&](double delay_s) {
      return part_of(loop_.step({loop_.timing.period_s, delay_s, 0.0}), LoopPart::across);
    };
    const double most_s = longest_delay_s(loop_.timing.period_s);
    const Critical critical =
        critical_value([&](double delay_s) { return mean_square_radius(chain, {step(delay_s)}); },
                       0.0, most_s, 1e-4);
    if (critical.kind != Critical::Kind::found) return without(row, why_none(critical));
    row.predicted = critical.value;
    const Points x = around(critical.value, INFINITY);
    row.linear = simulated_critical(x, trial_, [&](double s, std::uint64_t seed) {
      return linear_growth(chain, step(s), seed);
    });
    const double links_s =
        loop_.timing.total_s() - 1e-3 * scenario_.get<SensorSettings>().latency_ms;
    if (x.front() < links_s) {
      return without(row, fmt::format("the links' own delay, {:.0f} ms, is not below what is "
                                      "tried, from {:.0f} ms on",
                                      1e3 * links_s, 1e3 * x.front()));
    }
    compare_full(row, x, [&](double s, const PopulationTrial& trial) {
      Scenario late = scenario_;
      late.get<SensorSettings>().latency_ms = 1e3 * (s - links_s);
      return whole_loop_growth(late, 0.0, trial);
    });
    return row;
  }

  bool has_noise() const { return loop_.noise.position_m > 0.0 || loop_.noise.yaw_rad > 0.0; }

  VerifiedCritical excursion() const {
    VerifiedCritical row;
    row.quantity = VerifiedCritical::Quantity::excursion;
    const auto first = first_excursion(scenario_);
    if (!first) return without(row, "with plans, or noise that is not white, it is not reckoned");
    if (first->excursions == 0) {
      return without(row, fmt::format("none in {:.0f} s", first->driven_s));
    }
    row.predicted = first->mean_s.value;
    row.linear = SimulatedCritical{first->mean_s.value, first->mean_s.low, first->mean_s.high};
    row.why = why_not_full_;
    if (!row.why.empty()) return row;
    const FirstExcursion whole =
        first_excursion_of_runs(scenario_, trial_.seeds * trial_.runs_a_seed, trial_.jobs);
    if (whole.excursions == 0) {
      // Their absence has a lower bound, which the prediction may contradict.
      if (first->mean_s.high < whole.mean_s.low) return row;
      return without(row, fmt::format("no whole loop in {:.0f} s", whole.driven_s));
    }
    row.full = SimulatedCritical{whole.mean_s.value, whole.mean_s.low, whole.mean_s.high};
    return row;
  }

 private:
  static VerifiedCritical without(VerifiedCritical row, const std::string& why) {
    row.why = why;
    return row;
  }

  double linear_growth(const LossChain& chain, const LoopStep& step, std::uint64_t seed) const {
    return std::log(simulated_radius(
        chain, {step},
        {.loops = trial_.linear_loops, .periods = trial_.linear_periods, .seed = seed}));
  }

  template <class Growth>
  void compare_full(VerifiedCritical& row, const Points& x, const Growth& growth) const {
    row.why = why_not_full_;
    if (!row.why.empty()) return;
    std::atomic<double> largest_m = 0.0, speed_off = 0.0;
    row.full = simulated_critical(x, trial_, [&](double value, std::uint64_t seed) {
      const PopulationGrowth one =
          growth(value, {.loops = trial_.full_loops, .periods = trial_.full_periods, .seed = seed});
      raise(largest_m, one.largest_m);
      raise(speed_off, one.speed_off);
      return one.log_radius;
    });
    if (row.holds()) return;
    if (scenario_.get<VehicleSettings>().plant == VehicleSettings::Plant::ode) {
      row.why = "vehicle.plant = \"ode\": wheels have mass, and tyres slip";
    } else if (largest_m > kSmall_m) {
      row.why = fmt::format("loops got up to {:.2g} m off, where the law is not linear",
                            largest_m.load());
    } else if (speed_off > kSteady) {
      row.why = fmt::format("speeds varied by up to {:.2g} %, and gains with them",
                            100.0 * speed_off.load());
    }
  }

  const Scenario& scenario_;
  const VerificationTrial& trial_;
  StraightLoop loop_;
  std::string why_not_full_;
};

}  // namespace

double VerifiedCritical::off(const std::optional<SimulatedCritical>& simulated) const {
  return simulated && predicted ? simulated->value / *predicted - 1.0 : NAN;
}

bool VerifiedCritical::holds() const {
  if (!predicted) return !why.empty();
  if (quantity == Quantity::excursion) {
    if (!full) return !why.empty();
    return full->low <= linear->high && linear->low <= full->high;
  }
  if (!(std::abs(off(linear)) <= kLinearBar)) return false;
  return std::abs(off(full)) <= kFullBar || !why.empty();
}

std::vector<VerifiedCritical> verify_margins(const Scenario& scenario,
                                             const VerificationTrial& trial) {
  refuse_margin_obstacles(scenario);
  const Verifier verifier(scenario, trial);
  if (verifier.has_noise()) return {verifier.excursion()};
  return {verifier.prr(), verifier.delay()};
}

namespace {

bool is_delay(const VerifiedCritical& row) {
  return row.quantity == VerifiedCritical::Quantity::delay;
}

bool is_time(const VerifiedCritical& row) {
  return row.quantity == VerifiedCritical::Quantity::excursion;
}

const char* name(const VerifiedCritical& row, const char* prr, const char* delay,
                 const char* excursion) {
  return is_delay(row) ? delay : is_time(row) ? excursion : prr;
}

std::string number(const VerifiedCritical& row, double value) {
  if (is_time(row)) return fmt::format("{:.0f} s", value);
  return is_delay(row) ? fmt::format("{:.0f} ms", 1e3 * value) : fmt::format("{:.3f}", value);
}

std::string simulated(const VerifiedCritical& row, const std::optional<SimulatedCritical>& s) {
  if (!s) return "-";
  const double unit = is_delay(row) ? 1e3 : 1.0;
  if (is_time(row))
    return fmt::format("{} ({:.0f} to {:.0f})", number(row, s->value), s->low, s->high);
  return fmt::format("{} ± {:.{}f} ({:+.1f} %)", number(row, s->value),
                     0.5 * unit * (s->high - s->low), is_delay(row) ? 1 : 3, 100.0 * row.off(s));
}

nlohmann::ordered_json in_json(const std::optional<SimulatedCritical>& s) {
  if (!s) return nullptr;
  return {{"value", s->value}, {"low", s->low}, {"high", s->high}};
}

std::vector<std::string> plain(const Arm& arm) {
  std::vector<std::string> values;
  for (const KeyValue& setting : arm.settings) values.push_back(setting.plain());
  return values;
}

}  // namespace

VerificationTable::VerificationTable(const Experiment& experiment) : keys_(experiment.keys) {
  for (const std::string& key : keys_) widths_.push_back(key.size());
  for (const Arm& arm : experiment.arms) {
    const auto values = plain(arm);
    for (std::size_t i = 0; i < values.size(); ++i) {
      widths_[i] = std::max(widths_[i], values[i].size());
    }
  }
}

std::string VerificationTable::line(const std::vector<std::string>& settings,
                                    const std::vector<std::string>& cells) const {
  std::string text;
  for (std::size_t i = 0; i < settings.size(); ++i) {
    text += fmt::format("{:<{}}  ", settings[i], widths_[i]);
  }
  text += fmt::format("{:<9}  {:>9}  {:<26}  {:<26}  {}", cells[0], cells[1], cells[2], cells[3],
                      cells[4]);
  return text.substr(0, text.find_last_not_of(' ') + 1) + "\n";
}

std::string VerificationTable::head() const {
  return line(keys_, {"critical", "predicted", "linear loop", "whole loop", ""});
}

std::string VerificationTable::row(const Arm& arm, const VerifiedCritical& row) const {
  const std::string misses = row.holds() ? "" : "misses its bar";
  return line(plain(arm), {name(row, "PRR", "delay", "excursion"),
                           row.predicted ? number(row, *row.predicted) : "-",
                           simulated(row, row.linear), simulated(row, row.full),
                           misses + (misses.empty() || row.why.empty() ? "" : "; ") + row.why});
}

nlohmann::ordered_json verification_json(const Arm& arm, const VerifiedCritical& row) {
  nlohmann::ordered_json json;
  json["arm"] = arm.text();
  json["critical"] = name(row, "prr", "delay_s", "excursion_s");
  json["predicted"] = nullptr;
  if (row.predicted) json["predicted"] = *row.predicted;
  json["linear"] = in_json(row.linear);
  json["full"] = in_json(row.full);
  json["why"] = row.why;
  json["holds"] = row.holds();
  return json;
}

}  // namespace tether
