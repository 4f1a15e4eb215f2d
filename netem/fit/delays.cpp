#include "netem/fit/delays.hpp"

#include <algorithm>
#include <array>
#include <boost/math/distributions/gamma.hpp>
#include <boost/math/distributions/normal.hpp>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include "netem/fit/maximum.hpp"

namespace tether {
namespace {

/// A law of delays as maximum likelihood finds it, for DelayFit.
struct FittedLaw {
  std::string name;
  double lower_end = 0.0;  ///< origin of the mean; 0 for normal and uniform
  double mean = 0.0, sd = 0.0, shape = 3.0;
  /// Standard errors of lower end, mean, standard deviation and shape, of independent values; NaN:
  /// not determined, or the law does not have this parameter. For the lower end, 0 means: it is at
  /// a limit of where it is sought.
  double errors[4] = {};
  int free_parameters = 0;
  double log_likelihood = 0.0;  ///< for one value on average

  double cdf(double x) const;
};

using Fast = boost::math::policies::policy<boost::math::policies::promote_double<false>>;

constexpr std::size_t kMostValues = 20'000;
constexpr double kLeastShape = 2.02;  // shape of a Pareto law: below 2 there is no variance

double phi(double z) { return 0.5 * std::erfc(-z / std::numbers::sqrt2); }

/// Values from 0 with mean 1 over their least, and sums of them.
struct Sample {
  std::vector<double> values;
  double least_lower = 0.0, most_lower = 0.0;  // where a law's lower end may be; both below 0
  double logarithms = 0.0, squared_logarithms = 0.0, sum = 0.0;

  double size() const { return static_cast<double>(values.size()); }
  void sum_above(double lower) {
    logarithms = squared_logarithms = sum = 0.0;
    for (const double x : values) {
      const double y = x - lower, l = std::log(y);
      logarithms += l;
      squared_logarithms += l * l;
      sum += y;
    }
  }
};

/// Parameters of a law over the sample: lower end, then two more.
struct LawShape {
  double lower, a, b;
};

struct Family {
  const char* name;
  bool at_least_value;                              // the lower end is the least value itself
  double (*log_density)(Sample&, const LawShape&);  // mean of it
  double (*start_a)(double lower, double sd);
  double (*start_b)(double lower, double sd);
  /// mean, standard deviation, shape
  void (*moments)(const LawShape&, double& mean, double& sd, double& shape);
};

// a: shape k, b: scale θ
double gamma_density(Sample& s, const LawShape& p) {
  s.sum_above(p.lower);
  return (p.a - 1.0) * s.logarithms / s.size() - s.sum / s.size() / p.b - p.a * std::log(p.b) -
         std::lgamma(p.a);
}
// a: σ, b: median
double lognormal_density(Sample& s, const LawShape& p) {
  s.sum_above(p.lower);
  const double mu = std::log(p.b), mean = s.logarithms / s.size();
  const double square = s.squared_logarithms / s.size() - 2.0 * mu * mean + mu * mu;
  return -mean - std::log(p.a) - 0.5 * std::log(2.0 * std::numbers::pi) -
         0.5 * square / (p.a * p.a);
}
// a: tail index less kLeastShape, b: scale
double pareto_density(Sample& s, const LawShape& p) {
  const double index = p.a + kLeastShape;
  double sum = 0.0;
  for (const double x : s.values) sum += std::log1p((x - p.lower) / p.b);
  return std::log(index / p.b) - (index + 1.0) * sum / s.size();
}

const Family kFamilies[] = {
    {"gamma", false, gamma_density,
     [](double lower, double sd) { return std::pow((1.0 - lower) / sd, 2); },
     [](double lower, double sd) { return sd * sd / (1.0 - lower); },
     [](const LawShape& p, double& mean, double& sd, double&) {
       mean = p.a * p.b;
       sd = std::sqrt(p.a) * p.b;
     }},
    {"lognormal", false, lognormal_density,
     [](double lower, double sd) { return std::sqrt(std::log1p(std::pow(sd / (1.0 - lower), 2))); },
     [](double lower, double sd) {
       return (1.0 - lower) / std::sqrt(1.0 + std::pow(sd / (1.0 - lower), 2));
     },
     [](const LawShape& p, double& mean, double& sd, double&) {
       mean = p.b * std::exp(0.5 * p.a * p.a);
       sd = mean * std::sqrt(std::expm1(p.a * p.a));
     }},
    {"pareto", true, pareto_density, [](double, double) { return 1.0; },
     [](double, double) { return 2.0; },
     [](const LawShape& p, double& mean, double& sd, double& shape) {
       shape = p.a + kLeastShape;
       mean = p.b / (shape - 1.0);
       sd = mean * std::sqrt(shape / (shape - 2.0));
     }}};

/// From what is climbed (logit of the lower end within its bounds, if it is sought; logarithms) to
/// parameters.
LawShape shape_of(const Sample& s, const Eigen::VectorXd& u, std::optional<double> lower) {
  const Eigen::Index first = lower ? 0 : 1;
  const double sought =
      lower ? *lower : s.least_lower + (s.most_lower - s.least_lower) * logistic(u[0]);
  return {sought, std::exp(u[first]), std::exp(u[first + 1])};
}

Maximum climb(const Family& family, Sample& s, double sd, std::optional<double> lower) {
  std::optional<Maximum> best;
  for (const double depth : {-4.0, 0.0, 4.0}) {
    const double start =
        lower.value_or(s.least_lower + (s.most_lower - s.least_lower) * logistic(depth));
    Eigen::VectorXd u(lower ? 2 : 3);
    if (!lower) u[0] = depth;
    u[u.size() - 2] = std::log(family.start_a(start, sd));
    u[u.size() - 1] = std::log(family.start_b(start, sd));
    const Maximum m = maximise(
        [&](const Eigen::VectorXd& at) {
          return s.size() * family.log_density(s, shape_of(s, at, lower));
        },
        u);
    if (!best || m.value > best->value) best = m;
    if (lower) break;
  }
  return *best;
}

/// Standard errors of what `quantities` makes of the parameters, by their covariance.
void find_errors(FittedLaw& law, const Maximum& m,
                 const std::function<std::array<double, 4>(const Eigen::VectorXd&)>& quantities) {
  for (double& error : law.errors) error = kUnknown;
  if (m.covariance.rows() == 0) return;
  constexpr double kStep = 1e-4;
  Eigen::MatrixXd slopes(4, m.at.size());
  for (Eigen::Index i = 0; i < m.at.size(); ++i) {
    Eigen::VectorXd up = m.at, down = m.at;
    up[i] += kStep;
    down[i] -= kStep;
    const auto above = quantities(up), below = quantities(down);
    for (Eigen::Index k = 0; k < 4; ++k) {
      const auto j = static_cast<std::size_t>(k);
      slopes(k, i) = (above[j] - below[j]) / (2.0 * kStep);
    }
  }
  const Eigen::MatrixXd covariance = slopes * m.covariance * slopes.transpose();
  for (Eigen::Index k = 0; k < 4; ++k) {
    if (covariance(k, k) > 0.0) law.errors[k] = std::sqrt(covariance(k, k));
  }
}

FittedLaw fit_family(const Family& family, Sample& s, double sd) {
  std::optional<double> lower;
  if (family.at_least_value) lower = 0.0;
  Maximum m = climb(family, s, sd, lower);
  if (!lower && std::abs(m.at[0]) > 9.0) {  // at an end of where it may be
    lower = m.at[0] > 0.0 ? s.most_lower : s.least_lower;
    m = climb(family, s, sd, lower);
  }
  const auto quantities = [&](const Eigen::VectorXd& u) {
    const LawShape p = shape_of(s, u, lower);
    std::array<double, 4> all{p.lower, 0.0, 0.0, 3.0};
    family.moments(p, all[1], all[2], all[3]);
    return all;
  };
  const auto all = quantities(m.at);
  FittedLaw law{family.name, all[0], all[1], all[2], all[3], {}, 3, m.value / s.size()};
  find_errors(law, m, quantities);
  if (lower) law.errors[0] = family.at_least_value ? law.mean / s.size() : 0.0;
  return law;
}

double FittedLaw::cdf(double x) const {
  const double y = x - lower_end;
  if (name == "normal") return phi((y - mean) / sd);
  if (name == "uniform") {
    return std::clamp(0.5 + (y - mean) / (2.0 * std::numbers::sqrt3 * sd), 0.0, 1.0);
  }
  if (y <= 0.0) return 0.0;
  if (name == "gamma") {
    const boost::math::gamma_distribution<double, Fast> law(mean * mean / (sd * sd),
                                                            sd * sd / mean);
    return boost::math::cdf(law, y);
  }
  if (name == "lognormal") {
    const double variance = std::log1p(sd * sd / (mean * mean));
    return phi((std::log(y / mean) + 0.5 * variance) / std::sqrt(variance));
  }
  return 1.0 - std::pow(1.0 + y / (mean * (shape - 1.0)), -shape);
}

/// Fits each law to `sorted` values, ascending and not all the same; lower ends are not sought
/// below `lowest`. Of more than 20 000 values as many quantiles stand for all.
std::vector<FittedLaw> fit_laws(const std::vector<double>& sorted, double lowest) {
  Sample s;
  const double least = sorted.front(), n = static_cast<double>(sorted.size());
  double mean = 0.0, variance = 0.0;
  for (const double x : sorted) mean += x / n;
  for (const double x : sorted) variance += (x - mean) * (x - mean) / (n - 1.0);
  const double scale = mean - least, sd = std::sqrt(variance);
  const std::size_t count = std::min(sorted.size(), kMostValues);
  for (std::size_t i = 0; i < count; ++i) {
    const auto rank =
        static_cast<std::size_t>((static_cast<double>(i) + 0.5) * n / static_cast<double>(count));
    s.values.push_back((sorted[rank] - least) / scale);
  }
  // Likelihoods grow without bounds towards the least value; the lower end is rarely nearer to it
  // than that.
  s.most_lower = -1.0 / n;
  s.least_lower =
      std::min((std::max(lowest, least - 20.0 * scale) - least) / scale, 2.0 * s.most_lower);
  std::vector<FittedLaw> laws;
  const double log_sd = std::log(sd / scale);
  laws.push_back({"normal",
                  0.0,
                  mean,
                  sd,
                  3.0,
                  {kUnknown, sd / std::sqrt(n), sd / std::sqrt(2.0 * n), kUnknown},
                  2,
                  -0.5 * std::log(2.0 * std::numbers::pi) - log_sd - 0.5});
  const double width = sorted.back() - least;
  laws.push_back({"uniform",
                  0.0,
                  0.5 * (least + sorted.back()),
                  width / (2.0 * std::numbers::sqrt3),
                  3.0,
                  {kUnknown, width / n, width / n, kUnknown},
                  2,
                  -std::log(width / scale)});
  for (const Family& family : kFamilies) {
    FittedLaw law = fit_family(family, s, sd / scale);
    law.lower_end = least + scale * law.lower_end;
    law.mean *= scale;
    law.sd *= scale;
    for (const int k : {0, 1, 2}) {
      law.errors[k] *= scale * std::sqrt(static_cast<double>(count) / n);
    }
    law.errors[3] *= std::sqrt(static_cast<double>(count) / n);
    if (law.name != "pareto") law.errors[3] = kUnknown;
    laws.push_back(law);
  }
  return laws;
}

constexpr std::int64_t kFewestPairs = 50;

std::vector<double> known_delays(const DelayLog& log) {
  std::vector<double> delays;
  for (const auto& segment : log) {
    for (const double delay : segment) {
      if (!std::isnan(delay)) delays.push_back(delay);
    }
  }
  return delays;
}

/// The log with normal scores of ranks in place of delays; equal delays get one score.
DelayLog scores_of(const DelayLog& log, const std::vector<double>& sorted) {
  const auto n = static_cast<double>(sorted.size());
  DelayLog scores = log;
  for (auto& segment : scores) {
    for (double& x : segment) {
      if (std::isnan(x)) continue;
      const auto [low, high] = std::equal_range(sorted.begin(), sorted.end(), x);
      const double rank =
          0.5 * static_cast<double>((low - sorted.begin()) + (high - sorted.begin()));
      x = boost::math::quantile(boost::math::normal(),
                                std::clamp(rank / n, 0.5 / n, 1.0 - 0.5 / n));
    }
  }
  return scores;
}

struct Correlation {
  double value = 0.0;
  double pairs = 0.0;
};

/// Correlation of scores `lag` packets apart, where both packets arrived.
Correlation correlation_at(const DelayLog& scores, std::size_t lag) {
  double products = 0.0, squares = 0.0, pairs = 0.0;
  for (const auto& segment : scores) {
    for (std::size_t i = lag; i < segment.size(); ++i) {
      const double a = segment[i - lag], b = segment[i];
      if (std::isnan(a) || std::isnan(b)) continue;
      products += a * b;
      squares += 0.5 * (a * a + b * b);
      pairs += 1.0;
    }
  }
  return {squares > 0.0 ? products / squares : 0.0, pairs};
}

void correlate(const DelayLog& log, const std::vector<double>& sorted, DelayFit& fit) {
  const DelayLog scores = scores_of(log, sorted);
  const Correlation near = correlation_at(scores, 1);
  if (near.pairs < static_cast<double>(kFewestPairs)) return;
  const double c = near.value;
  const double error = std::sqrt((1.0 - c * c) / near.pairs);
  if (std::abs(c) < DelayFit::kSignificant / std::sqrt(near.pairs)) return;
  fit.correlation = std::clamp(c, -0.9999, 0.9999);
  fit.correlation_error = error;
  const Correlation far = correlation_at(scores, DelayFit::kFar);
  fit.far = far.value;
  fit.far_expected = std::pow(c, DelayFit::kFar);
  // Bartlett's, of an AR(1) sequence at lags beyond its memory; where one packet knows all of the
  // next, less is to be learned.
  fit.far_error = std::sqrt((1.0 + c * c) / (1.0 - c * c) / std::max(1.0, far.pairs));
}

double distance(const FittedLaw& law, const std::vector<double>& sorted) {
  const auto n = static_cast<double>(sorted.size());
  double most = 0.0;
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    const double f = law.cdf(sorted[i]), below = static_cast<double>(i) / n;
    most = std::max({most, f - below, below + 1.0 / n - f});
  }
  return most;
}

/// P[Kolmogorov's distance of n values > d], asymptotically.
double kolmogorov(double d, double n) {
  const double t = (std::sqrt(n) + 0.12 + 0.11 / std::sqrt(n)) * d;
  if (t < 0.3) return 1.0;
  double sum = 0.0;
  for (int k = 1; k <= 100; ++k) sum += (k % 2 == 1 ? 2.0 : -2.0) * std::exp(-2.0 * k * k * t * t);
  return std::clamp(sum, 0.0, 1.0);
}

FitParameter parameter(const char* name, double value, double error) {
  return {name, value, error, value - 1.96 * error, value + 1.96 * error, false};
}

DelayFit::Candidate candidate_of(const FittedLaw& law, const std::vector<double>& sorted,
                                 double effective) {
  DelayFit::Candidate c;
  c.law = law.name;
  c.sd_s = law.sd;
  c.shape = law.shape;
  const bool has_end = law.name != "normal" && law.name != "uniform";
  c.constant_s = has_end ? law.lower_end : law.mean;
  c.mean_s = has_end ? law.mean : 0.0;
  c.bic = law.free_parameters * std::log(effective) - 2.0 * effective * law.log_likelihood;
  c.distance = distance(law, sorted);
  c.p_value = kolmogorov(c.distance, effective);
  const double inflation = std::sqrt(static_cast<double>(sorted.size()) / effective) * 1e3;
  c.parameters.push_back(
      parameter("delay_ms", c.constant_s * 1e3, law.errors[has_end ? 0 : 1] * inflation));
  c.parameters.back().fixed = has_end && law.errors[0] == 0.0;
  if (has_end) {
    c.parameters.push_back(parameter("jitter.mean_ms", law.mean * 1e3, law.errors[1] * inflation));
  }
  c.parameters.push_back(parameter("jitter.sd_ms", law.sd * 1e3, law.errors[2] * inflation));
  if (law.name == "pareto") {
    c.parameters.push_back(parameter("jitter.shape", law.shape, law.errors[3] * inflation * 1e-3));
  }
  return c;
}

std::vector<double> quantiles(const std::vector<double>& sorted) {
  constexpr int kSteps = 100;
  std::vector<double> table;
  for (int i = 0; i <= kSteps; ++i) {
    const double position =
        static_cast<double>(i) / kSteps * static_cast<double>(sorted.size() - 1);
    const auto rank = std::min(static_cast<std::size_t>(position), sorted.size() - 2);
    const double share = position - static_cast<double>(rank);
    table.push_back(sorted[rank] + share * (sorted[rank + 1] - sorted[rank]));
  }
  return table;
}

}  // namespace

std::string DelayFit::law() const {
  if (candidates.empty()) return "none";
  return table_s.empty() ? candidates[best].law : "table";
}

DelayFit fit_delays(const DelayLog& log, double lowest_s) {
  constexpr double kSame_s = 1e-9;
  DelayFit fit;
  std::vector<double> sorted = known_delays(log);
  std::sort(sorted.begin(), sorted.end());
  fit.delays = std::ssize(sorted);
  fit.mean_s = sorted.empty() ? std::numeric_limits<double>::quiet_NaN()
                              : std::accumulate(sorted.begin(), sorted.end(), 0.0) /
                                    static_cast<double>(sorted.size());
  fit.effective = static_cast<double>(fit.delays);
  if (fit.delays < DelayFit::kFewest || sorted.back() - sorted.front() <= kSame_s) return fit;
  correlate(log, sorted, fit);
  const double c = std::max(0.0, fit.correlation);
  fit.effective = std::max(10.0, fit.effective * (1.0 - c) / (1.0 + c));
  for (const FittedLaw& law : fit_laws(sorted, lowest_s)) {
    fit.candidates.push_back(candidate_of(law, sorted, fit.effective));
    if (fit.candidates.back().bic < fit.candidates[fit.best].bic) {
      fit.best = fit.candidates.size() - 1;
    }
  }
  if (fit.candidates[fit.best].p_value < DelayFit::kFalseAlarm) fit.table_s = quantiles(sorted);
  return fit;
}

std::vector<double> delay_scores(const DelayLog& log) {
  std::vector<double> sorted = known_delays(log);
  std::ranges::sort(sorted);
  return known_delays(scores_of(log, sorted));
}

}  // namespace tether
