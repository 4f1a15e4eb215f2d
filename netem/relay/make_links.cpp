#include "netem/relay/make_links.hpp"

#include <fmt/format.h>

#include "common/base/errors.hpp"
#include "netem/channel/use.hpp"

namespace tether {
namespace {

Link make_link(const NetemSettings& settings, const ChannelModels& models,
               const std::string& name) {
  const LinkConfig& config = link_config(settings.get<ChannelSettings>(), name);
  return {config, models.of(name), link_streams(settings, name), load_delay_table(settings, name)};
}

}  // namespace

std::vector<double> load_delay_table(const NetemSettings& settings, const std::string& name) {
  try {
    return load_delay_table(link_config(settings.get<ChannelSettings>(), name).jitter);
  } catch (const UsageError& error) {
    throw UsageError(fmt::format("{}jitter.file: {}", link_key(name), error.what()));
  }
}

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
