#pragma once

#include <optional>
#include <string>

#include "netem/link/link_config.hpp"
#include "netem/stages/kinds.hpp"
#include "netem/statistics/channel_expectation.hpp"

namespace tether {

/// Expected statistics of a link's packets by its configuration, and those that the configuration
/// leaves open, with a short reason.
///
/// - Losses are the model's and `loss`: independent loss composes with that of every state. Packets
///   that find no room, or come during an outage, are not among them.
/// - Delays are service time at the bottleneck + max(0, the state's + jitter), without the latter
///   in the share of packets that `reorder` lets skip it: p for gap 1, else 1/(gap − 1 + 1/p).
///   The jitter's correlation c adds at most 2|c|/(1 − |c|) to variance inflation factors: no
///   function of two jointly normal numbers is more correlated than they are (Gebelein, ZAMM 21,
///   1941).
/// - Corruption and duplication change neither.
struct LinkExpectation {
  std::optional<ChannelExpectation> channel;  ///< none for recordings and maps
  bool moves_in_time = false;                 ///< states change with time, not with packets
  std::string no_losses;                      ///< why PRR, bursts and correlation are open, or ""
  std::string no_delays;                      ///< why delays are open, or ""
};

/// `link` is as scenario loading leaves it. Reads the file that its jitter names; throws
/// UsageError.
LinkExpectation expect_link(const LinkConfig& link, const LinkTraffic& traffic);

}  // namespace tether
