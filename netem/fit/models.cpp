#include "netem/fit/models.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include "common/base/errors.hpp"
#include "netem/fit/likelihood.hpp"
#include "netem/fit/maximum.hpp"
#include "netem/models/gilbert_elliott.hpp"
#include "netem/statistics/estimate.hpp"

namespace tether {
namespace {

struct Clusters {
  double count = 0.0, packets = 0.0, losses = 0.0;  // sums over the bad state
  double good_packets = 0.0, good_losses = 0.0;
};

/// Bad periods: from a loss to the last one that follows within `reach` packets each.
Clusters cluster(const RunLog& log, std::int64_t reach, bool lone_losses_are_good) {
  Clusters c;
  double packets = 0.0, losses = 0.0;
  const auto finish = [&] {
    if (losses == 0.0) return;
    if (losses == 1.0 && lone_losses_are_good) {
      c.good_packets += 1.0;
      c.good_losses += 1.0;
    } else {
      c.count += 1.0;
      c.packets += packets;
      c.losses += losses;
    }
    packets = losses = 0.0;
  };
  for (const auto& segment : log.segments()) {
    for (std::size_t i = 0; i < segment.size(); ++i) {
      const RunLog::Run& run = segment[i];
      const std::int64_t length = log.lengths(run.lost)[run.length_index];
      if (run.lost) {
        packets += static_cast<double>(length);
        losses += static_cast<double>(length);
      } else if (losses > 0.0 && length < reach && i + 1 < segment.size()) {
        packets += static_cast<double>(length);
      } else {
        finish();
        c.good_packets += static_cast<double>(length);
      }
    }
    finish();
  }
  return c;
}

double inside(double numerator, double denominator) {
  constexpr double kMargin = 1e-4;
  return std::clamp(denominator > 0.0 ? numerator / denominator : 0.5, kMargin, 1.0 - kMargin);
}

/// Places from which to climb the likelihood of a Gilbert–Elliott model: the three most likely of a
/// set. Each element of the set takes everything between losses no further apart than g packets as
/// the bad state. The set has g = 1, 2, 4 … 1024, with lone losses in the bad or in the good state.
/// 1−h is 1 unless it is free, 1−k is 0 unless it is free. All values are strictly inside (0, 1)
/// where free.
std::vector<GilbertElliott> fit_starts(const RunLog& log, bool free_bad, bool free_good) {
  std::vector<std::pair<double, GilbertElliott>> starts;
  for (std::int64_t reach = 1; reach <= 1024; reach *= 2) {
    for (const bool lone_are_good : {false, true}) {
      const Clusters c = cluster(log, reach, lone_are_good);
      if (c.count == 0.0) continue;
      const GilbertElliott m{inside(c.count, c.good_packets), inside(c.count, c.packets),
                             free_bad ? inside(c.losses, c.packets) : 1.0,
                             free_good ? inside(c.good_losses, c.good_packets) : 0.0};
      starts.emplace_back(log_likelihood(log, m), m);
    }
  }
  if (starts.empty())
    starts.emplace_back(0.0, GilbertElliott{0.1, 0.5, free_bad ? 0.9 : 1.0, free_good ? 0.1 : 0.0});
  std::stable_sort(starts.begin(), starts.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<GilbertElliott> best;
  for (std::size_t i = 0; i < std::min<std::size_t>(3, starts.size()); ++i) {
    best.push_back(starts[i].second);
  }
  return best;
}

double logit(double p) { return std::log(p / (1.0 - p)); }

/// One parameter of a model: where it is, whether it is free, and on which scale it moves.
struct Coordinate {
  const char* name;
  double value;
  bool free;
  bool probability;  // else a time

  double scaled() const { return probability ? logit(value) : std::log(value); }
  double natural(double u) const { return probability ? logistic(u) : std::exp(u); }
  double slope(double u) const { return probability ? logistic(u) * logistic(-u) : std::exp(u); }
};
using Coordinates = std::vector<Coordinate>;
using Values = std::vector<double>;

/// Maximises `likelihood` over the free coordinates, from their values.
ModelFit maximise_over(std::string name, const Coordinates& coordinates,
                       const std::function<double(const Values&)>& likelihood, Values& best) {
  Values start, all;
  for (const Coordinate& c : coordinates) {
    if (c.free) start.push_back(c.scaled());
    all.push_back(c.value);
  }
  const auto fill = [&](const Eigen::VectorXd& free) {
    Eigen::Index next = 0;
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (coordinates[i].free) all[i] = coordinates[i].natural(free[next++]);
    }
  };
  const Maximum maximum = maximise(
      [&](const Eigen::VectorXd& free) {
        fill(free);
        return likelihood(all);
      },
      Eigen::VectorXd::Map(start.data(), static_cast<Eigen::Index>(start.size())));
  fill(maximum.at);
  best = all;

  const double z = normal_quantile(0.95);
  ModelFit fit{std::move(name), {}, maximum.value, static_cast<int>(start.size())};
  Eigen::Index next = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Coordinate& c = coordinates[i];
    if (!c.free) {
      fit.parameters.push_back({c.name, c.value, 0.0, c.value, c.value, true});
      continue;
    }
    const double u = maximum.at[next];
    FitParameter p{c.name,
                   all[i],
                   kUnknown,
                   0.0,
                   c.probability ? 1.0 : std::numeric_limits<double>::infinity(),
                   false};
    if (maximum.covariance.rows() > 0) {
      const double sd = std::sqrt(maximum.covariance(next, next));
      p.standard_error = c.slope(u) * sd;
      p.low = c.natural(u - z * sd);
      p.high = c.natural(u + z * sd);
    }
    fit.parameters.push_back(p);
    ++next;
  }
  return fit;
}

PacketFit fit_independent(std::int64_t packets, std::int64_t lost) {
  const auto n = static_cast<double>(packets), k = static_cast<double>(lost);
  const double p = k / n;
  const Estimate e = proportion_interval(k, n, 0.95);
  PacketFit fit;
  fit.name = "independent losses";
  fit.model = {0.0, 1.0, 1.0, p};
  fit.free_parameters = 1;
  const double standard_error = k > 0.0 && k < n ? std::sqrt(p * (1.0 - p) / n) : kUnknown;
  fit.parameters = {{"1-prr", p, standard_error, e.low, e.high, false}};
  fit.log_likelihood = (k > 0.0 ? k * std::log(p) : 0.0) + (k < n ? (n - k) * std::log1p(-p) : 0.0);
  return fit;
}

struct Shape {
  const char* name;
  bool free_bad, free_good;  // whether 1−h and 1−k are estimated
};
constexpr std::array<Shape, 4> kShapes{{{"Gilbert (p, r)", false, false},
                                        {"Gilbert (p, r, 1-h)", true, false},
                                        {"Gilbert with residual loss (p, r, 1-k)", false, true},
                                        {"Gilbert-Elliott (p, r, 1-h, 1-k)", true, true}}};

PacketFit fit_gilbert_elliott(const RunLog& runs, const Shape& shape) {
  PacketFit best;
  best.log_likelihood = -std::numeric_limits<double>::infinity();
  for (const GilbertElliott& start : fit_starts(runs, shape.free_bad, shape.free_good)) {
    const Coordinates coordinates{{"p", start.p, true, true},
                                  {"r", start.r, true, true},
                                  {"1-h", start.one_minus_h, shape.free_bad, true},
                                  {"1-k", start.one_minus_k, shape.free_good, true}};
    Values v;
    const ModelFit fit = maximise_over(
        shape.name, coordinates,
        [&](const Values& x) {
          return log_likelihood(runs, GilbertElliott{x[0], x[1], x[2], x[3]});
        },
        v);
    if (fit.log_likelihood <= best.log_likelihood) continue;
    static_cast<ModelFit&>(best) = fit;
    best.model = {v[0], v[1], v[2], v[3]};
  }
  if (best.model.one_minus_h < best.model.one_minus_k) {  // the states have changed their roles
    std::swap(best.model.p, best.model.r);
    std::swap(best.model.one_minus_h, best.model.one_minus_k);
    std::swap(best.parameters[0], best.parameters[1]);
    std::swap(best.parameters[2], best.parameters[3]);
    const char* const names[] = {"p", "r", "1-h", "1-k"};
    for (std::size_t i = 0; i < 4; ++i) best.parameters[i].name = names[i];
  }
  return best;
}

std::optional<MarkovFit> fit_markov(const FateLog& log, const RunLog& runs, const PacketFit& like) {
  const GilbertElliott& g = like.model;
  const double correlation = 1.0 - g.p - g.r;
  if (!(correlation > 0.0) || !(log.interval_s > 0.0)) return std::nullopt;
  const double rate = -std::log(correlation) / log.interval_s, pi_bad = g.p / (g.p + g.r);
  const bool free_good = !like.parameters[3].fixed, free_bad = !like.parameters[2].fixed;
  const auto inside = [](double p) { return std::clamp(p, 1e-9, 1.0 - 1e-9); };
  const Coordinates coordinates{
      {"prr_good", free_good ? inside(1.0 - g.one_minus_k) : 1.0, free_good, true},
      {"prr_bad", free_bad ? inside(1.0 - g.one_minus_h) : 0.0, free_bad, true},
      {"mean_good_s", 1.0 / (pi_bad * rate), true, false},
      {"mean_bad_s", 1.0 / ((1.0 - pi_bad) * rate), true, false}};
  const auto likelihood = [&](const Values& x) {
    const MarkovModel model{x[0], x[1], x[2], x[3]};
    return log.periodic ? log_likelihood(runs, sampled(model, log.interval_s))
                        : log_likelihood(log, model);
  };
  Values v;
  MarkovFit fit;
  static_cast<ModelFit&>(fit) = maximise_over("Markov process in time", coordinates, likelihood, v);
  fit.model = {v[0], v[1], v[2], v[3]};
  return fit;
}

DelayLog delays_of(const FateLog& log) {
  DelayLog delays;
  for (const auto& segment : log.segments) {
    auto& out = delays.emplace_back();
    for (const LoggedPacket& p : segment) out.push_back(p.lost ? kUnknown : p.delay_s);
  }
  return delays;
}

void add_delays(const FateLog& log, MarkovFit& fit) {
  const std::vector<double> bad = bad_state_posterior(log, fit.model);
  double sums[2] = {0.0, 0.0}, weights[2] = {0.0, 0.0};
  std::size_t i = 0;
  for (const auto& segment : log.segments) {
    for (const LoggedPacket& p : segment) {
      const double w[2] = {1.0 - bad[i], bad[i]};
      ++i;
      if (p.lost || std::isnan(p.delay_s)) continue;
      for (int s : {0, 1}) {
        sums[s] += w[s] * p.delay_s;
        weights[s] += w[s];
      }
    }
  }
  fit.delay_good_s = weights[0] > 0.0 ? sums[0] / weights[0] : kUnknown;
  fit.delay_bad_s = weights[1] > 0.0 ? sums[1] / weights[1] : kUnknown;
  if (std::isnan(fit.delay_good_s) || std::isnan(fit.delay_bad_s)) return;
  DelayLog rest = delays_of(log);
  i = 0;
  for (auto& segment : rest) {
    for (double& x : segment) {
      x -= (1.0 - bad[i]) * fit.delay_good_s + bad[i] * fit.delay_bad_s;
      ++i;
    }
  }
  fit.delays = fit_delays(rest, -std::min(fit.delay_good_s, fit.delay_bad_s));
}

/// A log of the same packets whose state moves from good to bad with p and back with r; both may
/// depend on the time since the packet before.
template <class Steps>
FateBits simulate(const FateLog& log, const GilbertElliott& loss, double pi_bad, Steps steps,
                  RandomEngine& random) {
  FateBits bits;
  for (const auto& segment : log.segments) {
    auto& out = bits.emplace_back();
    out.reserve(segment.size());
    bool bad = uniform_01(random) < pi_bad;
    for (std::size_t i = 0; i < segment.size(); ++i) {
      if (i > 0) {
        const auto [p, r] = steps(segment[i].time_s - segment[i - 1].time_s);
        if (uniform_01(random) < (bad ? r : p)) bad = !bad;
      }
      out.push_back(uniform_01(random) < (bad ? loss.one_minus_h : loss.one_minus_k) ? 1 : 0);
    }
  }
  return bits;
}

FateBits bits_of(const FateLog& log) {
  FateBits observed;
  for (const auto& segment : log.segments) {
    auto& out = observed.emplace_back();
    for (const LoggedPacket& p : segment) out.push_back(p.lost ? 1 : 0);
  }
  return observed;
}

GoodnessOfFit test_choice(const FateLog& log, const FateBits& observed, const ChannelFit& fit,
                          RandomEngine random) {
  const GilbertElliott& g = fit.candidates[fit.best].model;
  const double pi_bad = g.p > 0.0 ? g.p / (g.p + g.r) : 0.0;
  const auto per_packet = [&](RandomEngine& r) {
    return simulate(
        log, g, pi_bad, [&](double) { return std::pair(g.p, g.r); }, r);
  };
  const auto in_time = [&](RandomEngine& r) {
    const MarkovModel& m = fit.markov->model;
    return simulate(
        log, sampled(m, 1.0), m.mean_bad_s / (m.mean_good_s + m.mean_bad_s),
        [&m](double interval_s) {
          const GilbertElliott s = sampled(m, interval_s);
          return std::pair(s.p, s.r);
        },
        r);
  };
  if (fit.choice == ChannelFit::Choice::markov) return goodness_of_fit(observed, in_time, random);
  return goodness_of_fit(observed, per_packet, random);
}

}  // namespace

double ModelFit::bic(std::int64_t packets) const {
  return free_parameters * std::log(static_cast<double>(packets)) - 2.0 * log_likelihood;
}

ChannelFit fit_channel(const FateLog& log, RandomEngine random) {
  ChannelFit fit;
  fit.packets = log.packets();
  fit.lost = log.lost();
  fit.interval_s = log.interval_s;
  fit.periodic = log.periodic;
  fit.delays = fit_delays(delays_of(log));
  if (fit.packets < 2) throw UsageError("fewer than two packets: nothing to fit");
  fit.candidates.push_back(fit_independent(fit.packets, fit.lost));
  fit.enough = std::min(fit.lost, fit.packets - fit.lost) >= kFewestEvents;
  if (!fit.enough) return fit;

  const RunLog runs(log);
  for (const Shape& shape : kShapes) {
    fit.candidates.push_back(fit_gilbert_elliott(runs, shape));
    const auto& newest = fit.candidates.back();
    if (newest.bic(fit.packets) < fit.candidates[fit.best].bic(fit.packets)) {
      fit.best = fit.candidates.size() - 1;
    }
  }
  if (fit.best > 0) {
    fit.markov = fit_markov(log, runs, fit.candidates[fit.best]);
    const bool in_time = !fit.periodic && fit.markov &&
                         fit.markov->log_likelihood > fit.candidates[fit.best].log_likelihood;
    fit.choice = in_time ? ChannelFit::Choice::markov : ChannelFit::Choice::gilbert_elliott;
    if (fit.markov) add_delays(log, *fit.markov);
  }
  const FateBits observed = bits_of(log);
  fit.goodness = test_choice(log, observed, fit, random);
  const bool in_time = fit.choice == ChannelFit::Choice::markov;
  // Equal delays have no ranks.
  const bool has_delays = !fit.delays.candidates.empty();
  fit.stationarity = test_stationarity(
      observed,
      in_time ? sampled(fit.markov->model, fit.interval_s) : fit.candidates[fit.best].model,
      has_delays ? delay_scores(delays_of(log)) : std::vector<double>{});
  return fit;
}

}  // namespace tether
