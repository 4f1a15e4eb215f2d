#include "netem/models/markov_chain.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/base/errors.hpp"

namespace tether {
namespace {

/// Index of the first entry above `luck` * the last one.
int pick(const std::vector<double>& cumulative, double luck) {
  const double target = luck * cumulative.back();
  const auto found = std::upper_bound(cumulative.begin(), cumulative.end(), target);
  // Rounding may put the target on the total: the last state with any probability has it.
  const auto last = std::lower_bound(cumulative.begin(), cumulative.end(), cumulative.back());
  return static_cast<int>(std::min(found, last) - cumulative.begin());
}

/// Running sums of a row, leaving out entry `without`.
std::vector<double> running_sum(const std::vector<double>& row, std::size_t without) {
  std::vector<double> sums(row.size());
  double sum = 0.0;
  for (std::size_t j = 0; j < row.size(); ++j) {
    if (j != without) sum += row[j];
    sums[j] = sum;
  }
  return sums;
}

constexpr std::size_t kNone = static_cast<std::size_t>(-1);

std::vector<double> stationary_or_throw(const Matrix& moves, const std::string& key) {
  auto share = stationary_distribution(moves);
  if (share) return *share;
  throw UsageError(
      fmt::format("{}: where the chain ends up depends on where it begins: there must be one state "
                  "that can be reached from every other",
                  key));
}

int draw_state(const std::vector<double>& share, RandomEngine& random) {
  return pick(running_sum(share, kNone), uniform_01(random));
}

}  // namespace

ChainClock::ChainClock(const Matrix& moves, double step_s, const std::string& key,
                       RandomEngine random)
    : step_s_(step_s), random_(random) {
  for (std::size_t i = 0; i < moves.size(); ++i) {
    cumulative_.push_back(running_sum(moves[i], i));
    leave_.push_back(cumulative_.back().back());
  }
  state_ = draw_state(stationary_or_throw(moves, key), random_);
  draw_sojourn(kStart);  // memoryless: no need to know when it began
}

ChainClock ChainClock::from_rates(const Matrix& rates_per_s, const std::string& key,
                                  RandomEngine random) {
  return {rates_per_s, 0.0, key, random};
}

ChainClock ChainClock::from_probabilities(const Matrix& probabilities, double step_s,
                                          const std::string& key, RandomEngine random) {
  return {probabilities, step_s, key, random};
}

void ChainClock::advance(Instant now) {
  while (until_ <= now) {
    state_ = pick(cumulative_[static_cast<std::size_t>(state_)], uniform_01(random_));
    draw_sojourn(until_);
  }
}

void ChainClock::draw_sojourn(Instant from) {
  constexpr double kLongest_s = 1e9;  // keeps the sum of a run's sojourns within nanosecond range
  const double leave = leave_[static_cast<std::size_t>(state_)];
  const double luck = 1.0 - uniform_01(random_);  // in (0, 1]
  if (leave <= 0.0) {
    until_ = Instant::max();
    return;
  }
  double sojourn_s = 0.0;
  if (step_s_ == 0.0) {
    sojourn_s = -std::log(luck) / leave;
  } else {
    const double steps = leave >= 1.0 ? 1.0 : 1.0 + std::floor(std::log(luck) / std::log1p(-leave));
    sojourn_s = steps * step_s_;
  }
  until_ = from + std::max(Duration{1}, from_seconds(std::min(kLongest_s, sojourn_s)));
}

ChainProcess::ChainProcess(std::shared_ptr<ChainClock> clock, std::vector<LinkCondition> conditions)
    : clock_(std::move(clock)), conditions_(std::move(conditions)) {}

PacketChainProcess::PacketChainProcess(const Matrix& probabilities,
                                       std::vector<LinkCondition> conditions,
                                       const std::string& key, RandomEngine random)
    : conditions_(std::move(conditions)),
      random_(random),
      state_(draw_state(stationary_or_throw(probabilities, key), random_)) {
  for (const auto& row : probabilities) cumulative_.push_back(running_sum(row, kNone));
}

PacketChainProcess::PacketChainProcess(const Matrix& probabilities,
                                       std::vector<LinkCondition> conditions,
                                       const std::string& key, const PacketChainProcess& before)
    : PacketChainProcess(probabilities, std::move(conditions), key, before.random_) {
  random_ = before.random_;
  state_ = before.state_;
}

LinkCondition PacketChainProcess::on_packet(Instant) {
  const LinkCondition met = condition();
  state_ = pick(cumulative_[static_cast<std::size_t>(state_)], uniform_01(random_));
  return met;
}

}  // namespace tether
