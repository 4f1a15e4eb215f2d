#pragma once

#include <string>

#include "netem/channel/settings.hpp"

namespace tether {

/// Reason why a key of a link has no effect, such as `channel.uplink.model is "fixed"`; empty if
/// the key has an effect. `prefix` is "channel.uplink." and so on, `part` what follows it.
std::string why_no_effect(const std::string& prefix, const LinkConfig& link,
                          const std::string& part);

/// Turns the pairs that may be given instead of a model's own parameters into these, so that the
/// next level beats them in either form: markov.p_bad and mean_cycle_s, gilbert_elliott.prr and
/// mean_burst. Completes names of files. Throws UsageError for what contradicts itself or cannot
/// be.
void resolve_link(const std::string& prefix, LinkConfig& link, const ScenarioLevel& level);

/// Why a link of [channel.links] cannot have this name; empty if it can. Its reports are on
/// NET/NAME.
std::string why_no_link_name(const std::string& name, const ChannelSettings& channel);

/// Checks what several keys together must fulfil. Throws UsageError.
void check_channel(const ChannelSettings& channel, const std::string& source);

}  // namespace tether
