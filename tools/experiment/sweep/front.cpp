#include "tools/experiment/sweep/front.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cassert>

#include "common/base/random.hpp"
#include "tools/experiment/statistics/pareto.hpp"
#include "tools/experiment/statistics/random_index.hpp"

namespace tether {
namespace {

using Runs = std::vector<std::vector<TunedRun>>;

/// The runs of these seeds, by number, of every condition.
Runs picked(const Runs& runs, const std::vector<std::size_t>& seeds) {
  Runs chosen(runs.size());
  for (std::size_t condition = 0; condition < runs.size(); ++condition) {
    for (const std::size_t seed : seeds) chosen[condition].push_back(runs[condition][seed]);
  }
  return chosen;
}

Interval error_interval(const WorthRule& rule, const Runs& runs, double measured) {
  const std::size_t n = runs.front().size();
  RandomEngine random = random_stream(kBootstrapSeed, "front");
  std::vector<double> resampled, without_one;
  std::vector<std::size_t> seeds(n);
  for (int i = 0; i < kResamples; ++i) {
    for (std::size_t& seed : seeds) seed = random_index(random, n);
    resampled.push_back(worth_of(rule, picked(runs, seeds)).survivors_error);
  }
  for (std::size_t left_out = 0; n > 1 && left_out < n; ++left_out) {
    seeds.clear();
    for (std::size_t seed = 0; seed < n; ++seed) {
      if (seed != left_out) seeds.push_back(seed);
    }
    without_one.push_back(worth_of(rule, picked(runs, seeds)).survivors_error);
  }
  return bca_interval(measured, std::move(resampled), without_one, kConfidence);
}

Tradeoff tradeoff_of(const Worth& worth) { return {worth.lost_share(), worth.survivors_error}; }

std::string gains_text(const std::vector<KeyValue>& gains) {
  std::vector<std::string> texts;
  for (const KeyValue& gain : gains) {
    std::string key = gain.key;
    if (key.starts_with("controller.")) key.erase(0, std::string("controller.").size());
    texts.push_back(fmt::format("{} {}", key, gain.plain()));
  }
  return fmt::format("{}", fmt::join(texts, ", "));
}

}  // namespace

std::vector<std::size_t> front_of(const std::vector<Worth>& candidates, std::size_t most) {
  assert(most >= 2);
  std::vector<Tradeoff> trades;
  for (const Worth& worth : candidates) trades.push_back(tradeoff_of(worth));
  std::vector<std::size_t> front;
  for (const std::size_t i : pareto_front(trades)) {
    const bool is_equal = !front.empty() && trades[front.back()].x == trades[i].x;
    if (!is_equal) front.push_back(i);
  }
  if (front.size() <= most) return front;
  std::vector<std::size_t> spread;
  for (std::size_t k = 0; k < most; ++k) {
    spread.push_back(front[(k * (front.size() - 1) + (most - 1) / 2) / (most - 1)]);
  }
  return spread;
}

FrontPoint front_point(const std::string& law, const std::vector<KeyValue>& gains,
                       const WorthRule& rule, const Runs& runs) {
  FrontPoint point{law, gains, {}, worth_of(rule, runs), {}, false};
  point.lost = share_of(point.worth.lost, point.worth.n, kConfidence);
  point.error_interval = error_interval(rule, runs, point.worth.survivors_error);
  return point;
}

void mark_front(std::vector<FrontPoint>& points) {
  std::vector<Tradeoff> trades;
  for (const FrontPoint& point : points) trades.push_back(tradeoff_of(point.worth));
  for (const std::size_t i : pareto_front(trades)) points[i].is_on_front = true;
}

std::string front_table(const std::vector<FrontPoint>& points,
                        const std::vector<std::string>& conditions) {
  std::string text =
      fmt::format("| law | lost | {} | error of the others | on the front |\n|{}\n",
                  fmt::join(conditions, " | "),
                  fmt::join(std::vector<std::string>(4 + conditions.size(), "-|"), ""));
  for (const FrontPoint& point : points) {
    text += fmt::format("| {} | {}/{} [{:.3g}, {:.3g}] % | {} | {:.3g} [{:.3g}, {:.3g}] | {} |\n",
                        point.law, point.lost.count, point.lost.n, 100.0 * point.lost.interval.low,
                        100.0 * point.lost.interval.high,
                        fmt::join(point.worth.lost_by_condition, " | "),
                        point.worth.survivors_error, point.error_interval.low,
                        point.error_interval.high, point.is_on_front ? "yes" : "");
  }
  return text;
}

std::string front_csv(const std::vector<FrontPoint>& points,
                      const std::vector<std::string>& conditions) {
  std::string text = "law,lost,n,lost_low,lost_high,error,error_low,error_high,on_front";
  for (const std::string& condition : conditions) text += fmt::format(",\"lost: {}\"", condition);
  text += ",gains\n";
  for (const FrontPoint& point : points) {
    text +=
        fmt::format("\"{}\",{},{},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{},{},\"{}\"\n", point.law,
                    point.lost.count, point.lost.n, point.lost.interval.low,
                    point.lost.interval.high, point.worth.survivors_error, point.error_interval.low,
                    point.error_interval.high, point.is_on_front ? 1 : 0,
                    fmt::join(point.worth.lost_by_condition, ","), gains_text(point.gains));
  }
  return text;
}

}  // namespace tether
