#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "netem/channel/settings.hpp"
#include "netem/link/channel_process.hpp"
#include "netem/link/link_stage.hpp"

namespace tether {

/// Processes that decide the conditions of some of a channel's links. With channel.shared_state up-
/// and downlink have the same clock, or the same process where it is a trace or a map.
struct ChannelModels {
  std::shared_ptr<ChannelProcess> uplink;  ///< both directions, or neither
  std::shared_ptr<ChannelProcess> downlink;
  std::map<std::string, std::shared_ptr<ChannelProcess>> links;  ///< processes of [channel.links]

  const std::shared_ptr<ChannelProcess>& of(const std::string& name) const;
};

/// Where a channel is when its settings change.
struct ChannelMoment {
  Instant now;
  std::map<std::string, std::int64_t> offered;  ///< packets so far, by link; none: 0
};

/// Makes the models of the named links of the scenario: "uplink", "downlink", names of
/// [channel.links]. Reads the files that the models name. Throws UsageError for those, and for a
/// chain without a single stationary distribution.
ChannelModels make_models(const NetemSettings& settings,
                          const std::vector<std::string>& names = {"uplink", "downlink"});

/// The models of scenario `after`, where those of `before` are in use; throws as make_models().
///
/// - Processes in time whose settings are the same stay the same object. So does the clock of a
///   Markov channel or chain if only conditions (PRR and delay of a state) are others: the times at
///   which it changes state stay.
/// - Other clocks and processes in time are made again and moved on to `now`: their state at t is
///   the function of (seed, t, settings) that it would have been had these settings been in force
///   from the start.
/// - Processes per packet of the same model (and, of chains, with as many states) go on in their
///   state and with their stream; others begin as at a link's start, with the draws that the n-th
///   packet would have met.
/// - A map that is made again knows where the vehicle was last.
ChannelModels renew_models(const ChannelModels& models, const NetemSettings& before,
                           const NetemSettings& after, const ChannelMoment& moment);

/// The streams of one link, "<vehicle>/uplink/<purpose>", "<vehicle>/downlink/<purpose>" or
/// "<vehicle>/links/<name>/<purpose>".
LinkStreams link_streams(const NetemSettings& settings, const std::string& name);

}  // namespace tether
