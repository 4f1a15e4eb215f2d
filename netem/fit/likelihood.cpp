#include "netem/fit/likelihood.hpp"

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <unordered_map>

namespace tether {
namespace {

constexpr double kImpossible = -std::numeric_limits<double>::infinity();

/// A matrix over the states good and bad, times exp(log_scale).
struct Step {
  Eigen::Matrix2d moves = Eigen::Matrix2d::Identity();
  double log_scale = 0.0;
};

Step product(const Step& a, const Step& b) {
  Step c{a.moves * b.moves, a.log_scale + b.log_scale};
  const double sum = c.moves(0, 0) + c.moves(0, 1) + c.moves(1, 0) + c.moves(1, 1);
  if (!(sum > 0.0)) return c;
  c.moves /= sum;
  c.log_scale += std::log(sum);
  return c;
}

Step power(Step base, std::int64_t exponent) {
  Step result;
  for (; exponent > 0; exponent /= 2) {
    if (exponent % 2 == 1) result = product(result, base);
    base = product(base, base);
  }
  return result;
}

double stationary_bad(double p, double r) { return p + r > 0.0 ? p / (p + r) : 0.0; }

/// Emission of a fate in either state, then the step of the chain.
Step step_of(bool lost, const GilbertElliott& m) {
  const double good = lost ? m.one_minus_k : 1.0 - m.one_minus_k;
  const double bad = lost ? m.one_minus_h : 1.0 - m.one_minus_h;
  Step step;
  step.moves << good * (1.0 - m.p), good * m.p, bad * m.r, bad * (1.0 - m.r);
  return step;
}

/// The logarithm of a product of many probabilities.
class LogProduct {
 public:
  void multiply(double factor) {
    scale_ *= factor;
    if (scale_ < 1e-200) take_logarithm();
  }
  void add(double logarithm) { sum_ += logarithm; }
  void take_logarithm() {
    sum_ += std::log(scale_);
    scale_ = 1.0;
  }
  double sum() const { return sum_; }  ///< up to what was last taken

 private:
  double sum_ = 0.0, scale_ = 1.0;
};

/// The chain over a time, for a process whose parts do not depend on it.
class TimeStep {
 public:
  explicit TimeStep(const MarkovModel& m)
      : pi_bad(m.mean_bad_s / (m.mean_good_s + m.mean_bad_s)),
        rate_per_s_(1.0 / m.mean_good_s + 1.0 / m.mean_bad_s) {}

  /// P[the state is drawn again within interval_s], up to the sign of correlation.
  double renewed(double interval_s) {
    if (interval_s != last_s_) {
      last_s_ = interval_s;
      renewed_ = -std::expm1(-rate_per_s_ * interval_s);
    }
    return renewed_;
  }

  const double pi_bad;

 private:
  double rate_per_s_;
  double last_s_ = -1.0;
  double renewed_ = 0.0;
};

}  // namespace

RunLog::RunLog(const FateLog& log) {
  std::array<std::unordered_map<std::int64_t, std::uint32_t>, 2> index;
  for (const auto& segment : log.segments) {
    std::vector<Run>& runs = segments_.emplace_back();
    for (std::size_t i = 0; i < segment.size();) {
      std::size_t end = i;
      while (end < segment.size() && segment[end].lost == segment[i].lost) ++end;
      const std::size_t fate = segment[i].lost ? 1 : 0;
      const auto length = static_cast<std::int64_t>(end - i);
      const auto [place, is_new] =
          index[fate].try_emplace(length, static_cast<std::uint32_t>(lengths_[fate].size()));
      if (is_new) lengths_[fate].push_back(length);
      runs.push_back({segment[i].lost, place->second});
      i = end;
    }
  }
}

double log_likelihood(const RunLog& log, const GilbertElliott& model) {
  std::array<std::vector<Step>, 2> steps;
  for (const bool lost : {false, true}) {
    const Step one = step_of(lost, model);
    for (std::int64_t length : log.lengths(lost)) {
      steps[lost ? 1 : 0].push_back(power(one, length));
    }
  }
  const double pi_bad = stationary_bad(model.p, model.r);
  LogProduct likelihood;
  for (const auto& segment : log.segments()) {
    Eigen::RowVector2d state(1.0 - pi_bad, pi_bad);
    for (const RunLog::Run& run : segment) {
      const Step& step = steps[run.lost ? 1 : 0][run.length_index];
      state *= step.moves;
      const double total = state.sum();
      if (!(total > 0.0)) return kImpossible;
      state /= total;
      likelihood.add(step.log_scale);
      likelihood.multiply(total);
    }
    likelihood.take_logarithm();
  }
  return likelihood.sum();
}

GilbertElliott sampled(const MarkovModel& m, double interval_s) {
  TimeStep step(m);
  const double a = step.renewed(interval_s);
  return {step.pi_bad * a, (1.0 - step.pi_bad) * a, 1.0 - m.prr_bad, 1.0 - m.prr_good};
}

double log_likelihood(const FateLog& log, const MarkovModel& m) {
  TimeStep step(m);
  LogProduct likelihood;
  for (const auto& segment : log.segments) {
    double bad = step.pi_bad;
    for (std::size_t i = 0; i < segment.size(); ++i) {
      if (i > 0) {
        bad += step.renewed(segment[i].time_s - segment[i - 1].time_s) * (step.pi_bad - bad);
      }
      const double by_good = (1.0 - bad) * (segment[i].lost ? 1.0 - m.prr_good : m.prr_good);
      const double by_bad = bad * (segment[i].lost ? 1.0 - m.prr_bad : m.prr_bad);
      const double total = by_good + by_bad;
      if (!(total > 0.0)) return kImpossible;
      bad = by_bad / total;
      likelihood.multiply(total);
    }
    likelihood.take_logarithm();
  }
  return likelihood.sum();
}

std::vector<double> bad_state_posterior(const FateLog& log, const MarkovModel& m) {
  TimeStep step(m);
  std::vector<double> posterior;
  for (const auto& segment : log.segments) {
    const std::size_t n = segment.size(), first = posterior.size();
    const auto emit = [&](std::size_t i, double prr) { return segment[i].lost ? 1.0 - prr : prr; };
    const auto renewed = [&](std::size_t i) {  // between packets i and i + 1
      return step.renewed(segment[i + 1].time_s - segment[i].time_s);
    };
    for (std::size_t i = 0; i < n; ++i) {  // forward: P[bad | fates up to i]
      double bad = step.pi_bad;
      if (i > 0) bad = posterior.back() + renewed(i - 1) * (step.pi_bad - posterior.back());
      const double by_good = (1.0 - bad) * emit(i, m.prr_good), by_bad = bad * emit(i, m.prr_bad);
      posterior.push_back(by_good + by_bad > 0.0 ? by_bad / (by_good + by_bad) : bad);
    }
    double good_later = 1.0, bad_later = 1.0;  // backward: P[fates after i | state at i]
    for (std::size_t i = n; i-- > 0;) {
      if (i + 1 < n) {
        const double a = renewed(i), to_bad = step.pi_bad * a, to_good = a - to_bad;
        const double good_next = emit(i + 1, m.prr_good) * good_later;
        const double bad_next = emit(i + 1, m.prr_bad) * bad_later;
        const double from_good = (1.0 - to_bad) * good_next + to_bad * bad_next;
        const double from_bad = to_good * good_next + (1.0 - to_good) * bad_next;
        good_later = from_good / (from_good + from_bad);
        bad_later = 1.0 - good_later;
      }
      double& bad = posterior[first + i];
      const double weight = bad * bad_later + (1.0 - bad) * good_later;
      if (weight > 0.0) bad = bad * bad_later / weight;
    }
  }
  return posterior;
}

}  // namespace tether
