#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "common/scenario.hpp"
#include "netem/channel_process.hpp"
#include "netem/link_stages.hpp"
#include "netem/markov_chain.hpp"
#include "netem/state_process.hpp"

namespace tether {

/// What decides one link's conditions.
struct LinkModel {
  /// What moves in time, whichever link it serves; null for other models.
  std::shared_ptr<StateProcess> markov;
  std::shared_ptr<ChainClock> chain;
  std::shared_ptr<ChannelProcess> process;
};

/// Of both links. With channel.shared_state both have the same clock, or the same process where it
/// is a trace or a map.
struct ChannelModels {
  LinkModel uplink;
  LinkModel downlink;
};

/// Where a channel is when its settings change.
struct ChannelMoment {
  Instant now;
  std::int64_t uplink_offered = 0;  ///< packets so far
  std::int64_t downlink_offered = 0;
};

/// Reads the files that the models name. Throws UsageError for those, and for a chain without a
/// single stationary distribution.
ChannelModels make_models(const Scenario& scenario);

/// The models of scenario `after`, where those of `before` are in use; throws as make_models().
///
/// - Processes in time whose settings are the same stay the same object. So does the clock of a
///   Markov channel or chain if only conditions (PRR and delay of a state) are others: the times at
///   which it changes state stay.
/// - Other clocks and processes in time are made anew and moved on to `now`: their state at t is
///   the function of (seed, t, settings) that it would have been had these settings been in force
///   from the start.
/// - Processes per packet of the same model (and, of chains, with as many states) go on in their
///   state and with their stream; others begin as at a link's start, with the draws that the n-th
///   packet would have met.
/// - A map that is made anew knows where the vehicle was last.
ChannelModels renew_models(const ChannelModels& models, const Scenario& before,
                           const Scenario& after, const ChannelMoment& moment);

/// One link's own model. `prefix`, such as "channel.uplink.", is for messages.
LinkModel make_model(const LinkConfig& config, const std::string& prefix,
                     const LinkStreams& streams);

/// The streams of one link, "<vehicle>/<name>/<purpose>"; `name` is "uplink", "downlink" or
/// "links/<name>".
LinkStreams link_streams(const Scenario& scenario, const std::string& name);

}  // namespace tether
