#include "netem/check/link_expectation.hpp"

#include <cmath>
#include <memory>
#include <numbers>
#include <utility>

#include "common/base/errors.hpp"
#include "netem/link/delay_law.hpp"
#include "netem/models/kinds.hpp"

namespace tether {
namespace {

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

/// The model's, and what the stages do to it.
ChannelExpectation expect_channel(const LinkConfig& link, ChannelExpectation channel) {
  channel.lose_independently(link.loss);
  const double c = std::abs(link.jitter.correlation);
  if (link.jitter.law != JitterConfig::Law::none) channel.add_delay_vif(2.0 * c / (1.0 - c));
  return channel;
}

}  // namespace

LinkExpectation expect_link(const LinkConfig& link, const std::vector<double>& delay_table_ms,
                            const LinkTraffic& traffic) {
  LinkExpectation e;
  const ChannelModelKind& kind = kind_of(link);
  if (kind.expect == nullptr) {
    e.no_losses = e.no_delays = kind.why_open;
    return e;
  }
  const DelayMaker delay(link, delay_table_ms, service_s(link, traffic));
  const ExpectedPackets packets{traffic.interval_s,
                                [&delay](double delay_ms) { return delay.of_state(delay_ms); }};
  try {
    e.channel = expect_channel(link, kind.expect(link, packets));
  } catch (const UsageError&) {
    e.no_losses = e.no_delays = "packets always come in the same phase of the chain";
    return e;
  }
  e.moves_in_time = kind.moves(link) == ChannelModelKind::Moves::in_time;
  e.no_delays = why_delays_are_open(link, *e.channel, traffic);
  if (kind.begins_in_first && !(e.channel->stationary()[0] > 0.0)) {
    e.no_losses = "the state in which the model begins is left for good";
  }
  if (!traffic.selected_because.empty()) e.no_losses = e.no_delays = traffic.selected_because;
  return e;
}

}  // namespace tether
