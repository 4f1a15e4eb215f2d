#include "tools/margin/verification.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "common/vehicle/vehicle_settings.hpp"
#include "margin/loop/loop_margins.hpp"
#include "margin/theory/linear_trial.hpp"
#include "netem/channel/settings.hpp"
#include "netem/models/kinds.hpp"

namespace tether {
namespace {

constexpr double kLinearBar = 0.05, kFullBar = 0.15;
constexpr double kStudent9 = 2.262;  // of ten seeds, and of ten groups: 97.5 %
constexpr std::size_t kPoints = 5;
using Points = std::array<double, kPoints>;

/// Where the quadratic of least squares through the points passes 0, nearest to their middle;
/// nullopt if that is farther off than twice the outermost ones.
std::optional<double> zero_of(const Points& x, const Points& y) {
  const double middle = 0.5 * (x.front() + x.back()), half = 0.5 * (x.back() - x.front());
  Eigen::Matrix<double, kPoints, 3> a;
  Eigen::Matrix<double, kPoints, 1> b;
  for (std::size_t i = 0; i < kPoints; ++i) {
    const double u = (x[i] - middle) / half;
    const auto row = static_cast<Eigen::Index>(i);
    a.row(row) << 1.0, u, u * u;
    b[row] = y[i];
  }
  const Eigen::Vector3d c = a.colPivHouseholderQr().solve(b);
  const double root = c[1] * c[1] - 4.0 * c[0] * c[2];
  if (!(root >= 0.0)) return std::nullopt;
  const double q = -0.5 * (c[1] + std::copysign(std::sqrt(root), c[1]));
  const double u = c[0] / q;  // the smaller one
  if (!(std::abs(u) <= 2.0)) return std::nullopt;
  return middle + half * u;
}

SimulatedCritical with_interval(double value, double deviation) {
  return {value, value - kStudent9 * deviation, value + kStudent9 * deviation};
}

/// `log_radius(x, seed)`. Each seed has a zero; the interval is Student's of their mean.
std::optional<SimulatedCritical> linear_critical(
    const Points& x, const std::function<double(double, std::uint64_t)>& log_radius) {
  constexpr std::size_t kSeeds = 10;
  double sum = 0.0, squares = 0.0;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    Points y{};
    for (std::size_t i = 0; i < kPoints; ++i) y[i] = log_radius(x[i], seed);
    const auto zero = zero_of(x, y);
    if (!zero) return std::nullopt;
    sum += *zero;
    squares += *zero * *zero;
  }
  constexpr double n = kSeeds;
  const double mean = sum / n, variance = std::max(0.0, squares / n - mean * mean) / (n - 1.0);
  return with_interval(mean, std::sqrt(variance));
}

/// A value with each group of runs left out, and at last with all.
using LeftOut = std::array<double, StraightTrial::kGroups + 1>;

/// The interval is the jackknife's.
std::optional<SimulatedCritical> full_critical(const Points& x,
                                               const std::function<LeftOut(double)>& value_at) {
  std::array<LeftOut, kPoints> values{};
  for (std::size_t i = 0; i < kPoints; ++i) values[i] = value_at(x[i]);
  const auto zero = [&](std::size_t without) {
    Points y{};
    for (std::size_t i = 0; i < kPoints; ++i) y[i] = values[i][without];
    return zero_of(x, y);
  };
  const auto all = zero(StraightTrial::kGroups);
  if (!all) return std::nullopt;
  constexpr double n = StraightTrial::kGroups;
  double squares = 0.0;
  for (std::size_t group = 0; group < StraightTrial::kGroups; ++group) {
    const auto one = zero(group);
    if (!one) return std::nullopt;
    squares += (*one - *all) * (*one - *all);
  }
  return with_interval(*all, std::sqrt(squares * (n - 1.0) / n));
}

/// Positive where the mean square is finite.
LeftOut stability_of(const Tail& tail) {
  LeftOut values{};
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = std::log(tail.exponent(i) / 2.0);
  return values;
}

Points around(double middle, double most) {
  const double low = (1.0 - kFullBar) * middle, high = std::min(most, (1.0 + kFullBar) * middle);
  Points x{};
  for (std::size_t i = 0; i < kPoints; ++i) {
    x[i] = low + (high - low) * static_cast<double>(i) / (kPoints - 1);
  }
  return x;
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
    const LoopStep step = part_of(loop_.step(loop_.timing), LoopPart::across);
    const auto chain_of = [&](double prr) { return loop_.chain(std::max(0.0, 1.0 - prr / own)); };
    const Critical critical =
        critical_value([&](double prr) { return mean_square_radius(chain_of(prr), {step}); },
                       0.01 * own, own, 1e-5);
    if (critical.kind != Critical::Kind::found) return without(row, why_none(critical));
    row.predicted = critical.value;
    row.linear = linear_critical(around(critical.value, own), [&](double prr, std::uint64_t seed) {
      return log_radius(chain_of(prr), step, seed);
    });
    compare_full(row, own, [&](double prr) {
      return stability_of(simulated_tail(scenario_, std::max(0.0, 1.0 - prr / own), trial_.full));
    });
    return row;
  }

  VerifiedCritical delay() const {
    VerifiedCritical row;
    row.quantity = VerifiedCritical::Quantity::delay;
    const LossChain chain = loop_.chain();
    const auto step = [&](double delay_s) {
      return part_of(loop_.step({loop_.timing.period_s, delay_s, 0.0}), LoopPart::across);
    };
    const double most_s = std::min(0.5, 12.0 * loop_.timing.period_s);
    const Critical critical =
        critical_value([&](double delay_s) { return mean_square_radius(chain, {step(delay_s)}); },
                       0.0, most_s, 1e-4);
    if (critical.kind != Critical::Kind::found) return without(row, why_none(critical));
    row.predicted = critical.value;
    row.linear = linear_critical(
        around(critical.value, INFINITY),
        [&](double s, std::uint64_t seed) { return log_radius(chain, step(s), seed); });
    const LinkConfig& up = scenario_.get<ChannelSettings>().uplink;
    const double other_s = loop_.timing.total_s() - 1e-3 * up.fixed.delay_ms;
    if (!kind_of(up).uses_delay_ms || (1.0 - kFullBar) * critical.value < other_s) {
      return without(row, "the uplink's delay cannot be set alone");
    }
    compare_full(row, INFINITY, [&](double s) {
      Scenario late = scenario_;
      late.get<ChannelSettings>().uplink.fixed.delay_ms = 1e3 * (s - other_s);
      if (chain.prr() < 1.0) return stability_of(simulated_tail(late, 0.0, trial_.full));
      LeftOut same{};
      same.fill(-simulated_growth(late));
      return same;
    });
    return row;
  }

 private:
  static VerifiedCritical without(VerifiedCritical row, const std::string& why) {
    row.why = why;
    return row;
  }

  double log_radius(const LossChain& chain, const LoopStep& step, std::uint64_t seed) const {
    return std::log(simulated_radius(
        chain, {step},
        {.loops = trial_.linear_loops, .periods = trial_.linear_periods, .seed = seed}));
  }

  void compare_full(VerifiedCritical& row, double most,
                    const std::function<LeftOut(double)>& value_at) const {
    row.why = why_not_full_;
    if (!row.why.empty()) return;
    row.full = full_critical(around(*row.predicted, most), value_at);
    if (scenario_.get<VehicleSettings>().plant == VehicleSettings::Plant::ode) {
      row.why = "vehicle.plant = \"ode\": wheels have mass, and tyres slip";
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
  if (!(std::abs(off(linear)) <= kLinearBar)) return false;
  return std::abs(off(full)) <= kFullBar || !why.empty();
}

std::vector<VerifiedCritical> verify_margins(const Scenario& scenario,
                                             const VerificationTrial& trial) {
  refuse_margin_obstacles(scenario);
  const Verifier verifier(scenario, trial);
  return {verifier.prr(), verifier.delay()};
}

}  // namespace tether
