#include "netem/check/link_expectation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <utility>

#include "common/base/errors.hpp"
#include "netem/link/delay_law.hpp"
#include "netem/models/channel_settings.hpp"

namespace tether {
namespace {

using Model = LinkConfig::Model;

/// P[x(z) <= value_s] for a standard normal z, where x never decreases.
double share_up_to(const DelayLaw& law, double value_s) {
  if (law.at_score(kMaxScore) <= value_s) return 1.0;
  if (law.at_score(-kMaxScore) > value_s) return 0.0;
  double low = -kMaxScore, high = kMaxScore;
  while (high - low > 1e-13) {
    const double middle = 0.5 * (low + high);
    if (middle == low || middle == high) break;
    (law.at_score(middle) <= value_s ? low : high) = middle;
  }
  return 0.5 * std::erfc(-low / std::numbers::sqrt2);
}

/// Makes the delay laws of a link's states.
class DelayMaker {
 public:
  DelayMaker(const LinkConfig& link, const std::vector<double>& table_ms, double service_s)
      : service_s_(service_s) {
    if (link.jitter.law != JitterConfig::Law::none) {
      law_ = std::make_shared<DelayLaw>(link.jitter, table_ms);
    }
    const auto& [probability, gap] = link.reorder;
    if (probability > 0.0) skipping_ = 1.0 / (static_cast<double>(gap - 1) + 1.0 / probability);
  }

  DelayCdf of_state(double delay_ms) const {
    const double state_s = delay_ms * 1e-3;
    return [*this, state_s](double delay_s) {
      const double after_service_s = delay_s - service_s_;
      if (after_service_s < 0.0) return 0.0;
      const double of_jitter_s = after_service_s - state_s;
      const double share =
          law_ ? share_up_to(*law_, of_jitter_s) : (of_jitter_s >= 0.0 ? 1.0 : 0.0);
      return skipping_ + (1.0 - skipping_) * share;
    };
  }

 private:
  std::shared_ptr<const DelayLaw> law_;
  double service_s_;
  double skipping_ = 0.0;  // share of the packets
};

ChannelExpectation expect_chain(const ChainConfig& chain, const DelayMaker& delay,
                                double interval_s) {
  std::vector<ExpectedState> states;
  for (std::size_t i = 0; i < chain.prr.size(); ++i) {
    states.push_back({fmt::format("state {}", i), chain.prr[i],
                      delay.of_state(chain.delay_ms.empty() ? 0.0 : chain.delay_ms[i])});
  }
  if (!chain.rates_per_s.empty()) {
    return ChannelExpectation::process(chain.rates_per_s, interval_s, std::move(states));
  }
  if (chain.step_s == 0.0) return ChannelExpectation::chain(chain.probabilities, std::move(states));
  return ChannelExpectation::stepped(chain.probabilities, chain.step_s, interval_s,
                                     std::move(states));
}

std::optional<ChannelExpectation> expect_model(const LinkConfig& link, const DelayMaker& delay,
                                               double interval_s) {
  const DelayCdf fixed_delay = delay.of_state(link.fixed.delay_ms);
  switch (link.model) {
    case Model::fixed:
      return ChannelExpectation::independent(link.fixed.prr, fixed_delay);
    case Model::markov:
      return ChannelExpectation::markov(link.mean_good_s, link.mean_bad_s, interval_s,
                                        {"good", link.good.prr, delay.of_state(link.good.delay_ms)},
                                        {"bad", link.bad.prr, delay.of_state(link.bad.delay_ms)});
    case Model::gilbert_elliott: {
      const GilbertElliottConfig& c = link.gilbert_elliott;
      return ChannelExpectation::gilbert_elliott(
          {c.p.value(), c.r.value(), c.one_minus_h, c.one_minus_k}, fixed_delay, fixed_delay);
    }
    case Model::four_state: {
      const FourStateConfig& c = link.four_state;
      const double p13 = c.p13.value();
      return ChannelExpectation::four_state({p13, c.p31.value_or(1.0 - p13), c.p32, c.p23, c.p14},
                                            fixed_delay);
    }
    case Model::chain:
      return expect_chain(link.chain, delay, interval_s);
    case Model::trace:
    case Model::map:
      return std::nullopt;
  }
  return std::nullopt;
}

bool moves_in_time(const LinkConfig& link) {
  return link.model == Model::markov ||
         (link.model == Model::chain &&
          (!link.chain.rates_per_s.empty() || link.chain.step_s > 0.0));
}

double service_s(const LinkConfig& link, const LinkTraffic& traffic) {
  if (link.rate.bits_per_s <= 0.0) return 0.0;
  const double bytes = traffic.packet_bytes + static_cast<double>(link.rate.overhead_bytes);
  return 8.0 * bytes / link.rate.bits_per_s;
}

bool delays_differ(const LinkConfig& link, const ChannelExpectation& channel) {
  return !channel.delay_is_constant() || link.reorder.probability > 0.0;
}

std::string why_delays_are_open(const LinkConfig& link, const ChannelExpectation& channel,
                                const LinkTraffic& traffic) {
  if (link.slot.period_ms > 0.0) return "packets wait for slots";
  if (link.rate.bits_per_s > 0.0) {
    if (!traffic.periodic)
      return "packets come irregularly and wait for each other at the rate limit";
    if (link.duplicate_probability > 0.0) return "packets wait for copies at the rate limit";
    if (service_s(link, traffic) > traffic.interval_s) {
      return "packets come faster than the rate limit lets them through";
    }
  }
  if (link.in_order && delays_differ(link, channel)) return "in_order holds packets back";
  return "";
}

}  // namespace

LinkExpectation expect_link(const LinkConfig& link, const std::vector<double>& delay_table_ms,
                            const LinkTraffic& traffic) {
  LinkExpectation e;
  const DelayMaker delay(link, delay_table_ms, service_s(link, traffic));
  if (link.model == Model::trace || link.model == Model::map) {
    e.no_losses = e.no_delays =
        link.model == Model::trace ? "the recording decides" : "where the vehicle is decides";
    return e;
  }
  try {
    e.channel = expect_model(link, delay, traffic.interval_s);
  } catch (const UsageError&) {
    e.no_losses = e.no_delays = "packets always come in the same phase of the chain";
    return e;
  }
  e.moves_in_time = moves_in_time(link);
  e.channel->lose_independently(link.loss);
  const double c = std::abs(link.jitter.correlation);
  if (link.jitter.law != JitterConfig::Law::none) e.channel->add_delay_vif(2.0 * c / (1.0 - c));
  e.no_delays = why_delays_are_open(link, *e.channel, traffic);
  // Gilbert and Elliott's and the four states' begin in the first, whether they return to it or
  // not.
  const bool begins_in_first =
      link.model == Model::gilbert_elliott || link.model == Model::four_state;
  if (begins_in_first && !(e.channel->stationary()[0] > 0.0)) {
    e.no_losses = "the state in which the model begins is left for good";
  }
  if (!traffic.selected_because.empty()) e.no_losses = e.no_delays = traffic.selected_because;
  return e;
}

}  // namespace tether
