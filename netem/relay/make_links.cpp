#include "netem/relay/make_links.hpp"

#include "netem/channel/use.hpp"
#include "netem/stages/kinds.hpp"

namespace tether {
namespace {

Link make_link(const NetemSettings& settings, const ChannelModels& models,
               const std::string& name) {
  const LinkConfig& config = link_config(settings.get<ChannelSettings>(), name);
  return {make_stages(config, link_key(name), link_streams(settings, name)), models.of(name)};
}

}  // namespace

LinkPair make_links(const NetemSettings& settings) {
  return make_links(settings, make_models(settings));
}

LinkPair make_links(const NetemSettings& settings, const ChannelModels& models) {
  return {make_link(settings, models, "uplink"), make_link(settings, models, "downlink")};
}

std::vector<Link> make_links(const NetemSettings& settings, const ChannelModels& models,
                             const std::vector<std::string>& names) {
  std::vector<Link> links;
  for (const std::string& name : names) links.push_back(make_link(settings, models, name));
  return links;
}

}  // namespace tether
