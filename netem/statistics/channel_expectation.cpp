#include "netem/statistics/channel_expectation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <utility>

#include "common/base/errors.hpp"

namespace tether {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

void check_rows(const DenseMatrix& transition) {
  for (std::size_t i = 0; i < transition.rows(); ++i) {
    double sum = 0.0;
    for (std::size_t j = 0; j < transition.columns(); ++j) sum += transition(i, j);
    if (!(std::abs(sum - 1.0) <= 1e-9)) {
      throw UsageError(fmt::format(
          "channel chain: the probabilities out of state {} sum to {}, not to 1", i, sum));
    }
  }
}

DenseMatrix product(const DenseMatrix& a, const DenseMatrix& b) {
  DenseMatrix c(a.rows(), b.columns());
  for (std::size_t i = 0; i < a.rows(); ++i) {
    for (std::size_t k = 0; k < a.columns(); ++k) {
      for (std::size_t j = 0; j < b.columns(); ++j) c(i, j) += a(i, k) * b(k, j);
    }
  }
  return c;
}

// exp(Q·Δ) by uniformisation, in steps short enough for the series to converge at once; all terms
// are positive, so nothing cancels.
DenseMatrix exponential(const DenseMatrix& rates, double interval_s) {
  const std::size_t n = rates.rows();
  double fastest = 0.0;
  std::vector<double> out(n, 0.0);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) out[i] += i == j ? 0.0 : rates(i, j);
    fastest = std::max(fastest, out[i]);
  }
  const int halvings =
      std::max(0, static_cast<int>(std::ceil(std::log2(1e-9 + 4.0 * fastest * interval_s))));
  const double jumps = fastest * std::ldexp(interval_s, -halvings);  // mean number in a step
  DenseMatrix uniform(n, n), term(n, n), sum(n, n);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) uniform(i, j) = fastest > 0.0 ? rates(i, j) / fastest : 0.0;
    uniform(i, i) = fastest > 0.0 ? 1.0 - out[i] / fastest : 1.0;
    term(i, i) = std::exp(-jumps);
  }
  constexpr int kTerms = 25;  // jumps <= 1/4: the rest is below 1e-40
  for (int k = 1; k <= kTerms; ++k) {
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = 0; j < n; ++j) sum(i, j) += term(i, j);
    }
    term = product(term, uniform);
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = 0; j < n; ++j) term(i, j) *= jumps / k;
    }
  }
  for (int k = 0; k < halvings; ++k) sum = product(sum, sum);
  return sum;
}

}  // namespace

DelayCdf constant_delay(double delay_s) {
  return [delay_s](double t_s) { return t_s >= delay_s ? 1.0 : 0.0; };
}

ChannelExpectation::ChannelExpectation(DenseMatrix transition, std::vector<ExpectedState> states)
    : transition_(std::move(transition)), states_(std::move(states)) {
  const std::size_t n = states_.size();
  assert(n > 0 && transition_.rows() == n && transition_.columns() == n);
  check_rows(transition_);
  stationary_ = stationary_shares(transition_);
  if (stationary_.empty()) {
    throw UsageError(
        "channel chain: its states fall into parts that cannot reach each other, so that its "
        "statistics depend on where it begins");
  }
  for (std::size_t s = 0; s < n; ++s) {
    double leave = 0.0;
    for (std::size_t t = 0; t < n; ++t) leave += t == s ? 0.0 : transition_(s, t);
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
      loss_pair_ += stationary_[s] * loss * transition_(s, t) * (1.0 - states_[t].prr);
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
  DenseMatrix stay(1, 1);
  stay(0, 0) = 1.0;
  return {stay, {{"only", prr, std::move(delay)}}};
}

ChannelExpectation ChannelExpectation::gilbert_elliott(const GilbertElliott& m, DelayCdf good_delay,
                                                       DelayCdf bad_delay) {
  const double p_bad_to_good = m.p == 0.0 && m.r == 0.0 ? 1.0 : m.r;  // begins, and stays, good
  DenseMatrix t(2, 2);
  t(0, 0) = 1.0 - m.p;
  t(0, 1) = m.p;
  t(1, 0) = p_bad_to_good;
  t(1, 1) = 1.0 - p_bad_to_good;
  return {t,
          {{"good", 1.0 - m.one_minus_k, std::move(good_delay)},
           {"bad", 1.0 - m.one_minus_h, std::move(bad_delay)}}};
}

ChannelExpectation ChannelExpectation::four_state(const FourState& m, DelayCdf delay) {
  DenseMatrix t(4, 4);
  t(0, 2) = m.p13;
  t(0, 3) = m.p14;
  t(0, 0) = 1.0 - m.p13 - m.p14;
  t(1, 2) = m.p23;
  t(1, 1) = 1.0 - m.p23;
  t(2, 0) = m.p31;
  t(2, 1) = m.p32;
  t(2, 2) = 1.0 - m.p31 - m.p32;
  t(3, 0) = 1.0;
  return {t,
          {{"received in a gap", 1.0, delay},
           {"received in a burst", 1.0, delay},
           {"lost in a burst", 0.0, delay},
           {"lost alone", 0.0, delay}}};
}

ChannelExpectation ChannelExpectation::markov(double mean_good_s, double mean_bad_s,
                                              double interval_s, ExpectedState good,
                                              ExpectedState bad) {
  const double p_bad = mean_bad_s / (mean_good_s + mean_bad_s);
  const double a = -std::expm1(-interval_s * (1.0 / mean_good_s + 1.0 / mean_bad_s));
  DenseMatrix t(2, 2);
  t(0, 1) = p_bad * a;
  t(0, 0) = 1.0 - t(0, 1);
  t(1, 0) = (1.0 - p_bad) * a;
  t(1, 1) = 1.0 - t(1, 0);
  ChannelExpectation e(t, {std::move(good), std::move(bad)});
  e.sojourns_ = {mean_good_s, mean_bad_s};
  e.unit_ = Unit::seconds;
  return e;
}

ChannelExpectation ChannelExpectation::chain(DenseMatrix transition,
                                             std::vector<ExpectedState> states) {
  return {std::move(transition), std::move(states)};
}

ChannelExpectation ChannelExpectation::process(const DenseMatrix& rates, double interval_s,
                                               std::vector<ExpectedState> states) {
  ChannelExpectation e(exponential(rates, interval_s), std::move(states));
  for (std::size_t i = 0; i < rates.rows(); ++i) {
    double out = 0.0;
    for (std::size_t j = 0; j < rates.columns(); ++j) out += i == j ? 0.0 : rates(i, j);
    e.sojourns_[i] = out > 0.0 ? 1.0 / out : kInfinity;
  }
  e.unit_ = Unit::seconds;
  return e;
}

ChannelExpectation ChannelExpectation::stepped(const DenseMatrix& probabilities, double step_s,
                                               double interval_s,
                                               std::vector<ExpectedState> states) {
  const std::size_t n = probabilities.rows();
  // Rows as exact as they can be: powers would multiply what they lack to 1.
  DenseMatrix step = probabilities, power(n, n);
  for (std::size_t i = 0; i < n; ++i) {
    double sum = 0.0;
    for (std::size_t j = 0; j < n; ++j) sum += step(i, j);
    for (std::size_t j = 0; j < n; ++j) step(i, j) /= sum;
    power(i, i) = 1.0;
  }
  constexpr double kRounding = 1e-9;  // of an interval that is a whole number of steps
  const double steps = interval_s / step_s;
  const double whole = std::floor(steps + kRounding);
  const double more = std::max(0.0, steps - whole);
  DenseMatrix square = step;
  for (double left = whole; left > 0.0; left = std::floor(0.5 * left)) {
    if (std::fmod(left, 2.0) == 1.0) power = product(power, square);
    square = product(square, square);
  }
  const DenseMatrix next = product(power, step);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) power(i, j) += more * (next(i, j) - power(i, j));
  }
  ChannelExpectation e(power, std::move(states));
  for (std::size_t i = 0; i < n; ++i) {
    const double leave = 1.0 - step(i, i);
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
  const auto index = [](std::size_t s, int lost, int before) {
    return 4 * s + 2 * static_cast<std::size_t>(lost) + static_cast<std::size_t>(before);
  };
  const auto emit = [&](std::size_t s, int lost) {
    return lost == 1 ? 1.0 - states_[s].prr : states_[s].prr;
  };
  DenseMatrix transition(4 * n, 4 * n), functions(4 * n, 2);
  std::vector<double> stationary(4 * n);
  for (std::size_t s = 0; s < n; ++s) {
    for (int code = 0; code < 4; ++code) {
      const int lost = code / 2, before = code % 2;
      const std::size_t from = index(s, lost, before);
      functions(from, 0) = lost;
      functions(from, 1) = lost * before;
      for (std::size_t t = 0; t < n; ++t) {
        for (int next : {0, 1})
          transition(from, index(t, next, lost)) = transition_(s, t) * emit(t, next);
        stationary[from] += stationary_[t] * emit(t, before) * transition_(t, s) * emit(s, lost);
      }
    }
  }
  const DenseMatrix covariance = asymptotic_covariance(transition, stationary, functions);
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
  const std::size_t n = states_.size();
  DenseMatrix mean(n, 1);
  double within = 0.0;
  for (std::size_t s = 0; s < n; ++s) {
    const double f = states_[s].delay(quantile_s), prr = states_[s].prr;
    mean(s, 0) = prr * (f - share);
    const double square = prr * (f * (1.0 - share) * (1.0 - share) + (1.0 - f) * share * share);
    within += stationary_[s] * (square - mean(s, 0) * mean(s, 0));
  }
  const double variance = within + asymptotic_covariance(transition_, stationary_, mean)(0, 0);
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
