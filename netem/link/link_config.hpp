#pragma once

#include <string>

#include "common/scenario/own_settings.hpp"

namespace tether {

/// One state of a channel.
struct ChannelStateConfig {
  double prr = 1.0;       ///< packet reception ratio, 0..1
  double delay_ms = 0.0;  ///< constant delay of the packets received in this state

  bool operator==(const ChannelStateConfig&) const = default;
};

/// One direction of the network: what decides its conditions (the model,
/// netem/models/kinds.hpp), then the stages that a packet passes (netem/stages/kinds.hpp).
struct LinkConfig {
  std::string model = "fixed";  ///< the name of one of channel_model_kinds()
  /// The one state of the model fixed; of others with one delay in all states: that delay.
  ChannelStateConfig fixed;
  OwnSettings own;  ///< settings of models and stages: own.get<MarkovConfig>()

  bool operator==(const LinkConfig&) const = default;
};

}  // namespace tether
