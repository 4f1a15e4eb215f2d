#include "netem/make_links.hpp"

namespace tether {

std::shared_ptr<ChannelProcess> make_process(const LinkConfig& config, const std::string& prefix,
                                             const LinkStreams& streams) {
  return make_model(config, prefix, streams).process;
}

LinkPair make_links(const Scenario& scenario) {
  return make_links(scenario, make_models(scenario));
}

LinkPair make_links(const Scenario& scenario, const ChannelModels& models) {
  const LinkConfig &up = scenario.channel.uplink, &down = scenario.channel.downlink;
  return {Link(up, models.uplink.process, link_streams(scenario, "uplink"),
               load_delay_table(up.jitter)),
          Link(down, models.downlink.process, link_streams(scenario, "downlink"),
               load_delay_table(down.jitter))};
}

}  // namespace tether
