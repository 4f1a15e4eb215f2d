#include "netem/channel/link_keys.hpp"

#include <algorithm>

#include "netem/models/kinds.hpp"
#include "netem/stages/kinds.hpp"

namespace tether {
namespace {

/// Names of the models that use one of the link's own keys.
std::string names_of_models(bool ChannelModelKind::*uses) {
  std::string names;
  for (const ChannelModelKind& kind : channel_model_kinds()) {
    if (kind.*uses) names += (names.empty() ? "" : ", ") + kind.name;
  }
  return "model = " + names;
}

}  // namespace

std::vector<ScenarioKey> link_keys(const std::string& prefix,
                                   const ScenarioField<LinkConfig>& link) {
  KeyTable<LinkConfig> t(prefix, link);
  std::vector<std::string> models;
  for (const ChannelModelKind& kind : channel_model_kinds()) models.push_back(kind.name);
  t.one_of("model", &LinkConfig::model, models, "model that sets loss and delay of the link");
  t.number("prr", TETHER_MEMBER(fixed.prr), kRatio,
           names_of_models(&ChannelModelKind::uses_prr) + ": packet reception ratio");
  t.number("delay_ms", TETHER_MEMBER(fixed.delay_ms), kDelayRange_ms,
           names_of_models(&ChannelModelKind::uses_delay_ms) + ": delay");
  for (const ChannelModelKind& kind : channel_model_kinds()) {
    if (kind.keys != nullptr) t.append(kind.keys({prefix, link}));
  }
  for (const LinkStageKind& stage : link_stage_kinds()) {
    if (stage.keys != nullptr) t.append(stage.keys({prefix, link}));
  }
  // Keys of the link itself come before those of its parts: that is the order of TOML's sections.
  std::vector<ScenarioKey> keys = t.take();
  std::stable_partition(keys.begin(), keys.end(), [&prefix](const ScenarioKey& key) {
    return key.name.find('.', prefix.size()) == std::string::npos;
  });
  return keys;
}

}  // namespace tether
