#include "netem/stages/kinds.hpp"

#include <fmt/format.h>

namespace tether {

#define TETHER_LINK_STAGES(STAGE) \
  STAGE(state)                    \
  STAGE(room)                     \
  STAGE(outages)                  \
  STAGE(loss)                     \
  STAGE(corrupt)                  \
  STAGE(duplicate)                \
  STAGE(rate)                     \
  STAGE(jitter)                   \
  STAGE(reorder)                  \
  STAGE(in_order)                 \
  STAGE(slots)

#define TETHER_DECLARE(name) LinkStageKind name##_stage();
TETHER_LINK_STAGES(TETHER_DECLARE)

const std::vector<LinkStageKind>& link_stage_kinds() {
#define TETHER_ROW(name) name##_stage(),
  static const std::vector<LinkStageKind> kinds{TETHER_LINK_STAGES(TETHER_ROW)};
  return kinds;
}

LinkStages make_stages(const StageNeeds& needs) {
  LinkStages stages;
  for (const LinkStageKind& kind : link_stage_kinds()) {
    if (StagePtr stage = kind.make(needs)) stages.push_back(std::move(stage));
  }
  return stages;
}

LinkStages make_stages(const LinkConfig& link, const std::string& prefix,
                       const LinkStreams& streams) {
  return make_stages({.link = link, .prefix = prefix, .streams = streams});
}

LinkStages renewed_stages(const Link& link, const LinkConfig& before, const LinkConfig& after,
                          const std::string& prefix, const LinkStreams& streams) {
  return make_stages({.link = after,
                      .prefix = prefix,
                      .streams = streams,
                      .before = &before,
                      .present = &link.stages(),
                      .offered = link.counters().offered,
                      .last_departure = link.under_way().last_departure()});
}

std::string why_off(const std::string& prefix, double value, const std::string& switch_key,
                    const std::string& part) {
  const std::string table = switch_key.substr(0, switch_key.find('.') + 1);
  if (value != 0.0 || part == switch_key || !part.starts_with(table)) return "";
  return fmt::format("{}{} is 0", prefix, switch_key);
}

}  // namespace tether
