#pragma once

#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"
#include "netem/channel/models.hpp"
#include "netem/channel/settings.hpp"
#include "netem/link/link.hpp"

namespace tether {

/// The two links of a scenario, each with its own random streams, "<vehicle>/uplink/<purpose>" and
/// "<vehicle>/downlink/<purpose>"; with the uplink's state for both where channel.shared_state says
/// so. Reads the files that models and stages name. Throws UsageError for those, and for a chain
/// without a single stationary distribution.
struct LinkPair {
  Link uplink;
  Link downlink;
};
LinkPair make_links(const NetemSettings& settings);
/// The same with models that have been made already.
LinkPair make_links(const NetemSettings& settings, const ChannelModels& models);

/// Makes the named links of a scenario, in this order; `names` are "uplink", "downlink" and
/// those in its channel.links, each at most once, and `models` made for them. The latter have
/// the random streams "<vehicle>/links/<name>/<purpose>". Throws as make_links() does.
std::vector<Link> make_links(const NetemSettings& settings, const ChannelModels& models,
                             const std::vector<std::string>& names);

}  // namespace tether
