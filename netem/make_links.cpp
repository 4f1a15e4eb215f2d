#include "netem/make_links.hpp"

#include <optional>
#include <utility>

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

std::vector<Link> make_links(const Scenario& scenario, const std::vector<std::string>& names) {
  std::optional<LinkPair> pair;
  std::vector<Link> links;
  for (const std::string& name : names) {
    if (name == "uplink" || name == "downlink") {
      if (!pair) pair.emplace(make_links(scenario));
      links.push_back(std::move(name == "uplink" ? pair->uplink : pair->downlink));
    } else {
      const LinkConfig& config = scenario.channel.links.at(name);
      const LinkStreams streams = link_streams(scenario, "links/" + name);
      const std::string prefix = "channel.links." + name + ".";
      links.emplace_back(config, make_process(config, prefix, streams), streams,
                         load_delay_table(config.jitter));
    }
  }
  return links;
}

}  // namespace tether
