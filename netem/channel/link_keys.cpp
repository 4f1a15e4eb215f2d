#include "netem/channel/link_keys.hpp"

#include <algorithm>

#include "netem/models/kinds.hpp"
#include "netem/stages/kinds.hpp"

namespace tether {

std::vector<ScenarioKey> link_keys(const std::string& prefix,
                                   const ScenarioField<LinkConfig>& link) {
  KeyTable<LinkConfig> t(prefix, link);
  std::vector<std::string> models;
  for (const ChannelModelKind& kind : channel_model_kinds()) models.push_back(kind.name);
  t.one_of("model", &LinkConfig::model, models, "what decides the conditions of the link");
  t.number("prr", TETHER_MEMBER(fixed.prr), kRatio, "model = fixed: packet reception ratio");
  t.number("delay_ms", TETHER_MEMBER(fixed.delay_ms), kDelayRange_ms,
           "model = fixed, gilbert_elliott, four_state: delay");
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
