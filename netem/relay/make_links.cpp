#include "netem/relay/make_links.hpp"

#include <fmt/format.h>

#include "common/base/errors.hpp"
#include "netem/models/channel_use.hpp"

namespace tether {
namespace {

Link make_link(const Scenario& scenario, const ChannelModels& models, const std::string& name) {
  const LinkConfig& config = link_config(scenario, name);
  return {config, models.of(name).process, link_streams(scenario, name),
          load_delay_table(scenario, name)};
}

}  // namespace

std::vector<double> load_delay_table(const Scenario& scenario, const std::string& name) {
  try {
    return load_delay_table(link_config(scenario, name).jitter);
  } catch (const UsageError& error) {
    throw UsageError(fmt::format("{}jitter.file: {}", link_key(name), error.what()));
  }
}

LinkPair make_links(const Scenario& scenario) {
  return make_links(scenario, make_models(scenario));
}

LinkPair make_links(const Scenario& scenario, const ChannelModels& models) {
  return {make_link(scenario, models, "uplink"), make_link(scenario, models, "downlink")};
}

std::vector<Link> make_links(const Scenario& scenario, const ChannelModels& models,
                             const std::vector<std::string>& names) {
  std::vector<Link> links;
  for (const std::string& name : names) links.push_back(make_link(scenario, models, name));
  return links;
}

}  // namespace tether
