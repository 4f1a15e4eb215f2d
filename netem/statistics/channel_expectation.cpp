#include "netem/statistics/channel_expectation.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <unsupported/Eigen/MatrixFunctions>
#include <utility>

#include "common/base/errors.hpp"

namespace tether {
namespace {

/// Which states can be reached from which, in any number of moves, none included.
std::vector<std::vector<bool>> reachable(const Matrix& moves) {
  const std::size_t n = moves.size();
  std::vector<std::vector<bool>> reach(n, std::vector<bool>(n));
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) reach[i][j] = i == j || moves[i][j] > 0.0;
  }
  for (std::size_t via = 0; via < n; ++via) {
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = 0; j < n; ++j) {
        if (reach[i][via] && reach[via][j]) reach[i][j] = true;
      }
    }
  }
  return reach;
}

/// The states that every state leads to, which are never left together; empty if there are none.
std::vector<std::size_t> closed_class(const Matrix& moves) {
  const auto reach = reachable(moves);
  std::vector<std::size_t> members;
  for (std::size_t j = 0; j < moves.size(); ++j) {
    if (std::all_of(reach.begin(), reach.end(), [j](const auto& row) { return row[j]; })) {
      members.push_back(j);
    }
  }
  return members;
}

}  // namespace

std::optional<std::vector<double>> stationary_distribution(const Matrix& moves) {
  const std::vector<std::size_t> members = closed_class(moves);
  if (members.empty()) return std::nullopt;
  const std::size_t n = members.size();
  Matrix a(n, std::vector<double>(n));
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) a[i][j] = moves[members[i]][members[j]];
  }
  // Take out one state after the other, from the last: its moves pass to those that remain.
  for (std::size_t k = n - 1; k > 0; --k) {
    double out = 0.0;
    for (std::size_t j = 0; j < k; ++j) out += a[k][j];
    for (std::size_t i = 0; i < k; ++i) {
      a[i][k] /= out;
      for (std::size_t j = 0; j < k; ++j) a[i][j] += a[i][k] * a[k][j];
    }
  }
  std::vector<double> weight(n, 1.0);
  double total = 1.0;
  for (std::size_t k = 1; k < n; ++k) {
    weight[k] = 0.0;
    for (std::size_t i = 0; i < k; ++i) weight[k] += weight[i] * a[i][k];
    total += weight[k];
  }
  std::vector<double> share(moves.size(), 0.0);
  for (std::size_t k = 0; k < n; ++k) share[members[k]] = weight[k] / total;
  return share;
}

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

MatrixXd dense(const Matrix& rows) {
  const auto n = static_cast<Eigen::Index>(rows.size());
  return MatrixXd::NullaryExpr(n, n, [&rows](Eigen::Index i, Eigen::Index j) {
    return rows[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)];
  });
}

Matrix rows_of(const MatrixXd& m) {
  Matrix rows;
  for (const auto row : m.rowwise()) rows.emplace_back(row.begin(), row.end());
  return rows;
}

VectorXd vector(const std::vector<double>& values) {
  return VectorXd::Map(values.data(), static_cast<Eigen::Index>(values.size()));
}

void check_rows(const Matrix& transition) {
  for (std::size_t i = 0; i < transition.size(); ++i) {
    const double sum = std::accumulate(transition[i].begin(), transition[i].end(), 0.0);
    if (!(std::abs(sum - 1.0) <= 1e-9)) {
      throw UsageError(fmt::format(
          "channel chain: the probabilities out of state {} sum to {}, not to 1", i, sum));
    }
  }
}

// n·Cov(mean of column i, mean of column j of `functions`) of time averages along a stationary
// chain; `functions` has one row per state. With g = (I − P + 1π)⁻¹(f − πf), the fundamental
// matrix's solution of Poisson's equation, σ_ij = Σ_s π_s (f̃_i g_j + f̃_j g_i − f̃_i f̃_j)(s) (Kemeny
// & Snell, Finite Markov Chains, 1960, section 4.6). It counts covariances of all lags.
MatrixXd asymptotic_covariance(const MatrixXd& transition, const VectorXd& stationary,
                               const MatrixXd& functions) {
  const MatrixXd centred = functions.rowwise() - stationary.transpose() * functions;
  MatrixXd a = MatrixXd::Identity(transition.rows(), transition.cols()) - transition;
  a.rowwise() += stationary.transpose();
  const MatrixXd g = a.partialPivLu().solve(centred);
  const MatrixXd weighted = stationary.asDiagonal() * centred;
  const MatrixXd once = weighted.transpose() * g;
  return once + once.transpose() - weighted.transpose() * centred;
}

}  // namespace

DelayCdf constant_delay(double delay_s) {
  return [delay_s](double t_s) { return t_s >= delay_s ? 1.0 : 0.0; };
}

ChannelExpectation::ChannelExpectation(Matrix transition, std::vector<ExpectedState> states,
                                       const Matrix& moves)
    : transition_(std::move(transition)), states_(std::move(states)) {
  const std::size_t n = states_.size();
  assert(n > 0 && transition_.size() == n && moves.size() == n);
  check_rows(transition_);
  auto stationary = stationary_distribution(moves);
  if (!stationary) {
    throw UsageError(
        "channel chain: its states fall into parts that cannot reach each other, so that its "
        "statistics depend on where it begins");
  }
  stationary_ = *std::move(stationary);
  for (std::size_t s = 0; s < n; ++s) {
    double leave = 0.0;
    for (std::size_t t = 0; t < n; ++t) leave += t == s ? 0.0 : transition_[s][t];
    sojourns_.push_back(leave > 0.0 ? 1.0 / leave : kInfinity);
  }
  predict_losses();
}

void ChannelExpectation::predict_losses() {
  loss_ = loss_pair_ = 0.0;
  for (std::size_t s = 0; s < states_.size(); ++s) {
    const double loss = 1.0 - states_[s].prr;
    loss_ += stationary_[s] * loss;
    for (std::size_t t = 0; t < states_.size(); ++t) {
      loss_pair_ += stationary_[s] * loss * transition_[s][t] * (1.0 - states_[t].prr);
    }
  }
  spread_ = make_spread();
}

void ChannelExpectation::lose_independently(double probability) {
  if (probability == 0.0) return;
  for (ExpectedState& state : states_) state.prr *= 1.0 - probability;
  predict_losses();
}

ChannelExpectation ChannelExpectation::independent(double prr, DelayCdf delay) {
  return chain({{1.0}}, {{"only", prr, std::move(delay)}});
}

ChannelExpectation ChannelExpectation::chain(const Matrix& transition,
                                             std::vector<ExpectedState> states) {
  return {transition, std::move(states), transition};
}

ChannelExpectation ChannelExpectation::in_time(const Matrix& transition,
                                               std::vector<ExpectedState> states,
                                               std::vector<double> mean_sojourns_s) {
  ChannelExpectation e = chain(transition, std::move(states));
  e.sojourns_ = std::move(mean_sojourns_s);
  e.unit_ = Unit::seconds;
  return e;
}

ChannelExpectation ChannelExpectation::process(const Matrix& rates, double interval_s,
                                               std::vector<ExpectedState> states) {
  MatrixXd q = dense(rates);
  q.diagonal().setZero();
  const VectorXd leave = q.rowwise().sum();
  q.diagonal() = -leave;
  ChannelExpectation e(rows_of((q * interval_s).exp()), std::move(states), rates);
  for (std::size_t i = 0; i < rates.size(); ++i) {
    const double rate = leave[static_cast<Eigen::Index>(i)];
    e.sojourns_[i] = rate > 0.0 ? 1.0 / rate : kInfinity;
  }
  e.unit_ = Unit::seconds;
  return e;
}

ChannelExpectation ChannelExpectation::stepped(const Matrix& probabilities, double step_s,
                                               double interval_s,
                                               std::vector<ExpectedState> states) {
  // Rows as exact as they can be: powers would multiply what they lack to 1.
  MatrixXd step = dense(probabilities);
  const VectorXd sums = step.rowwise().sum();
  step.array().colwise() /= sums.array();
  constexpr double kRounding = 1e-9;  // rounding of an interval that is a whole number of steps
  const double steps = interval_s / step_s;
  const double whole = std::floor(steps + kRounding);
  const double more = std::max(0.0, steps - whole);
  MatrixXd power = MatrixXd::Identity(step.rows(), step.cols()), square = step;
  for (double left = whole; left > 0.0; left = std::floor(0.5 * left)) {
    if (std::fmod(left, 2.0) == 1.0) power *= square;  // Eigen's pow() takes 12 s to compile
    square *= square;
  }
  auto e = chain(rows_of((1.0 - more) * power + more * power * step), std::move(states));
  for (std::size_t i = 0; i < probabilities.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const double leave = 1.0 - step(k, k);
    e.sojourns_[i] = leave > 0.0 ? step_s / leave : kInfinity;
  }
  e.unit_ = Unit::seconds;
  return e;
}

double ChannelExpectation::mean_burst() const {
  return loss_ > 0.0 ? loss_ / (loss_ - loss_pair_) : kNaN;
}

double ChannelExpectation::lag1_correlation() const {
  if (!(loss_ > 0.0 && loss_ < 1.0)) return kNaN;
  const double correlation = (loss_pair_ - loss_ * loss_) / (loss_ * (1.0 - loss_));
  constexpr double kRounding = 1e-12;
  return std::abs(correlation) < kRounding ? 0.0 : correlation;
}

double ChannelExpectation::changes_per_s() const {
  double sum = 0.0;
  for (std::size_t s = 0; s < states_.size(); ++s) sum += stationary_[s] / sojourns_[s];
  return unit_ == Unit::seconds ? sum : 0.0;
}

// The chain of (state, lost, was the one before lost) carries both functions: lost, and lost twice.
LossSpread ChannelExpectation::make_spread() const {
  const std::size_t n = states_.size();
  const auto index = [](std::size_t s, Eigen::Index lost, Eigen::Index before) {
    return static_cast<Eigen::Index>(4 * s) + 2 * lost + before;
  };
  const auto emit = [&](std::size_t s, int lost) {
    return lost == 1 ? 1.0 - states_[s].prr : states_[s].prr;
  };
  MatrixXd transition = MatrixXd::Zero(index(n, 0, 0), index(n, 0, 0));
  MatrixXd functions(transition.rows(), 2);
  VectorXd stationary = VectorXd::Zero(transition.rows());
  for (std::size_t s = 0; s < n; ++s) {
    for (int code = 0; code < 4; ++code) {
      const int lost = code / 2, before = code % 2;
      const Eigen::Index from = index(s, lost, before);
      functions.row(from) << lost, lost * before;
      for (std::size_t t = 0; t < n; ++t) {
        for (int next : {0, 1})
          transition(from, index(t, next, lost)) = transition_[s][t] * emit(t, next);
        stationary[from] += stationary_[t] * emit(t, before) * transition_[t][s] * emit(s, lost);
      }
    }
  }
  const MatrixXd covariance = asymptotic_covariance(transition, stationary, functions);
  return loss_spread(loss_, loss_pair_, covariance(0, 0), covariance(0, 1), covariance(1, 1));
}

double ChannelExpectation::delay_cdf(double delay_s) const {
  if (!(loss_ < 1.0)) return 0.0;
  double sum = 0.0;
  for (std::size_t s = 0; s < states_.size(); ++s) {
    sum += stationary_[s] * states_[s].prr * states_[s].delay(delay_s);
  }
  return sum / (1.0 - loss_);
}

double ChannelExpectation::delay_quantile(double q) const {
  // Sums of shares are exact to some 1e-16 only; a quantile at a jump must not fall beyond it.
  const auto reached = [&](double t_s) { return delay_cdf(t_s) >= q - 1e-12; };
  if (!(loss_ < 1.0)) return kNaN;
  if (reached(0.0)) return 0.0;
  double low = 0.0, high = 1e-9;
  while (!reached(high)) {
    low = high;
    high *= 2.0;
    if (high > 1e6) return kNaN;
  }
  while (high - low > 1e-12 * high) {
    const double middle = 0.5 * (low + high);
    (reached(middle) ? high : low) = middle;
  }
  return high;
}

double ChannelExpectation::delay_vif(double q) const {
  const double quantile_s = delay_quantile(q);
  if (std::isnan(quantile_s)) return 1.0;
  const double share = delay_cdf(quantile_s);
  constexpr double kRounding = 1e-12;
  if (!(share > kRounding && share < 1.0 - kRounding)) return 1.0 + more_delay_vif_;
  // The ratio's linearisation: received·(1[delay <= quantile] − share), whose mean is 0.
  std::vector<double> means;
  double within = 0.0;
  for (std::size_t s = 0; s < states_.size(); ++s) {
    const double f = states_[s].delay(quantile_s), prr = states_[s].prr;
    const double mean = prr * (f - share);
    const double square = prr * (f * (1.0 - share) * (1.0 - share) + (1.0 - f) * share * share);
    within += stationary_[s] * (square - mean * mean);
    means.push_back(mean);
  }
  const double variance =
      within + asymptotic_covariance(dense(transition_), vector(stationary_), vector(means))(0, 0);
  const double vif = variance / ((1.0 - loss_) * share * (1.0 - share));
  return std::max(1.0, vif) + more_delay_vif_;
}

bool ChannelExpectation::delay_is_constant() const {
  const double middle_s = delay_quantile(0.5);
  if (std::isnan(middle_s)) return false;
  constexpr double kSlack_s = 2e-9, kRounding = 1e-12;
  return delay_cdf(middle_s - kSlack_s) <= kRounding &&
         delay_cdf(middle_s + kSlack_s) >= 1.0 - kRounding;
}

}  // namespace tether
