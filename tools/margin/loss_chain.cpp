#include "tools/margin/loss_chain.hpp"

#include "common/base/errors.hpp"

namespace tether {
namespace {

void add(LossChain& chain, const LossChain::Jump& jump) {
  if (jump.probability > 0.0) chain.jumps.push_back(jump);
}

LossChain with_stationary(LossChain chain) {
  Matrix moves(chain.states, std::vector<double>(chain.states, 0.0));
  for (const auto& jump : chain.jumps) moves[jump.from][jump.to] += jump.probability;
  const auto stationary = stationary_distribution(moves);
  if (!stationary) {
    throw UsageError(
        "the channel's chain has no unique stationary distribution: more than one set "
        "of states is never left");
  }
  chain.stationary = *stationary;
  return chain;
}

}  // namespace

ChainLink ChainLink::bursts(double prr, double mean_burst) {
  const double r = 1.0 / mean_burst, p = (1.0 - prr) / (prr * mean_burst);
  return {{{1.0 - p, p}, {r, 1.0 - r}}, {1.0, 0.0}, true};
}

double LossChain::prr() const {
  double sum = 0.0;
  for (const Jump& jump : jumps) {
    if (jump.mode == kReceived) sum += stationary[jump.from] * jump.probability;
  }
  return sum;
}

std::optional<int> LossChain::silence_periods(double share) const {
  std::vector<double> silent(states);  // since a command arrived
  double all = 0.0;
  for (const Jump& jump : jumps) {
    if (jump.mode != kReceived) continue;
    silent[jump.to] += stationary[jump.from] * jump.probability;
    all += stationary[jump.from] * jump.probability;
  }
  constexpr int kMost = 100'000;
  for (int periods = 1; all > 0.0 && periods <= kMost; ++periods) {
    std::vector<double> next(states);
    for (const Jump& jump : jumps) {
      if (jump.mode == kLost) next[jump.to] += silent[jump.from] * jump.probability;
    }
    silent = next;
    double left = 0.0;
    for (const double p : silent) left += p;
    if (left <= share * all) return periods;
  }
  return std::nullopt;
}

LossChain both_links(const ChainLink& uplink, const ChainLink& downlink) {
  const std::size_t ups = uplink.prr.size(), downs = downlink.prr.size();
  LossChain chain{.states = ups * downs, .jumps = {}, .stationary = {}};
  for (std::size_t i = 0; i < ups; ++i) {
    for (std::size_t j = 0; j < downs; ++j) {
      for (std::size_t to_i = 0; to_i < ups; ++to_i) {
        for (std::size_t to_j = 0; to_j < downs; ++to_j) {
          const std::size_t from = i * downs + j, to = to_i * downs + to_j;
          const double up = uplink.transition[i][to_i];
          const double moved = downlink.transition[j][to_j];
          const double rests = j == to_j ? 1.0 : 0.0;
          const double unheard = downlink.steps_by_packets ? rests : moved;
          const double heard = up * uplink.prr[i] * moved;
          add(chain, {from, to, heard * downlink.prr[j], LossChain::kReceived});
          add(chain,
              {from, to, heard * (1.0 - downlink.prr[j]) + up * (1.0 - uplink.prr[i]) * unheard,
               LossChain::kLost});
        }
      }
    }
  }
  return with_stationary(std::move(chain));
}

LossChain shared_links(const ChainLink& uplink, const std::vector<double>& downlink_prr) {
  LossChain chain{.states = uplink.prr.size(), .jumps = {}, .stationary = {}};
  for (std::size_t i = 0; i < chain.states; ++i) {
    const double both = uplink.prr[i] * downlink_prr[i];
    for (std::size_t to = 0; to < chain.states; ++to) {
      add(chain, {i, to, uplink.transition[i][to] * both, LossChain::kReceived});
      add(chain, {i, to, uplink.transition[i][to] * (1.0 - both), LossChain::kLost});
    }
  }
  return with_stationary(std::move(chain));
}

}  // namespace tether
