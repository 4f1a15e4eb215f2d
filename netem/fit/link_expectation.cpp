#include "netem/fit/link_expectation.hpp"

#include <utility>

#include "common/base/errors.hpp"
#include "netem/models/kinds.hpp"

namespace tether {
namespace {

/// The law of all delay, where the model delays by so much.
DelayCdf delay_law(const StageEffects& effects, double delay_ms) {
  return [effects, delay_s = delay_ms * 1e-3](double value_s) {
    const double after_service_s = value_s - effects.service_s;
    if (after_service_s < 0.0) return 0.0;
    const double of_jitter_s = after_service_s - delay_s;
    const double share =
        effects.jitter ? effects.jitter(of_jitter_s) : (of_jitter_s >= 0.0 ? 1.0 : 0.0);
    return effects.share_that_skips + (1.0 - effects.share_that_skips) * share;
  };
}

std::string why_delays_are_open(const StageEffects& effects, const ChannelExpectation& channel) {
  const bool differ = !channel.delay_is_constant() || effects.share_that_skips > 0.0;
  return effects.no_delays.empty() && differ ? effects.keeps_order : effects.no_delays;
}

}  // namespace

LinkExpectation expect_link(const LinkConfig& link, const LinkTraffic& traffic) {
  LinkExpectation e;
  const ChannelModelKind& kind = kind_of(link);
  if (kind.expect == nullptr) {
    e.no_losses = e.no_delays = kind.why_open;
    return e;
  }
  StageEffects effects;
  for (const LinkStageKind& stage : link_stage_kinds()) {
    if (stage.expect != nullptr) stage.expect(link, traffic, effects);
  }
  const ExpectedPackets packets{
      traffic.interval_s, [&effects](double delay_ms) { return delay_law(effects, delay_ms); }};
  try {
    e.channel = kind.expect(link, packets);
  } catch (const UsageError&) {
    e.no_losses = e.no_delays = "packets always come in the same phase of the chain";
    return e;
  }
  e.channel->lose_independently(effects.loss);
  e.channel->add_delay_vif(effects.delay_vif);
  e.moves_in_time = kind.moves(link) == ChannelModelKind::Moves::in_time;
  e.no_delays = why_delays_are_open(effects, *e.channel);
  if (kind.begins_in_first && !(e.channel->stationary()[0] > 0.0)) {
    e.no_losses = "the state in which the model begins is left for good";
  }
  if (!traffic.selected_because.empty()) e.no_losses = e.no_delays = traffic.selected_because;
  return e;
}

}  // namespace tether
