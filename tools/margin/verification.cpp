#include "tools/margin/verification.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <functional>

#include "common/vehicle/vehicle_settings.hpp"
#include "margin/loop/loop_margins.hpp"
#include "margin/loop/survival.hpp"
#include "margin/theory/linear_trial.hpp"
#include "netem/statistics/estimate.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "tools/margin/loop_population.hpp"
#include "tools/margin/parallel.hpp"
#include "tools/margin/settled_error.hpp"

namespace tether {
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

}  // namespace tether
