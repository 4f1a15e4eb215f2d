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
#undef TETHER_DECLARE

const std::vector<LinkStageKind>& link_stage_kinds() {
#define TETHER_ROW(name) name##_stage(),
  static const std::vector<LinkStageKind> kinds{TETHER_LINK_STAGES(TETHER_ROW)};
#undef TETHER_ROW
  return kinds;
}

namespace {

bool is_on(const LinkStageKind& kind, const LinkConfig& link) {
  return kind.on == nullptr || kind.on(link);
}

std::string why_off(const LinkStageKind& kind, const std::string& prefix, const LinkConfig& link,
                    const std::string& part) {
  const auto dot = kind.switch_key.find('.');
  const bool in_its_table =
      dot != std::string::npos && part.starts_with(kind.switch_key.substr(0, dot + 1));
  if (is_on(kind, link) || !in_its_table || part == kind.switch_key) return "";
  return fmt::format("{}{} is 0", prefix, kind.switch_key);
}

}  // namespace

LinkStages make_stages(const StageNeeds& needs) {
  LinkStages stages;
  for (const LinkStageKind& kind : link_stage_kinds()) {
    if (is_on(kind, needs.link)) stages.push_back(kind.make(needs));
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

std::string why_no_effect_on_stages(const std::string& prefix, const LinkConfig& link,
                                    const std::string& part) {
  for (const LinkStageKind& kind : link_stage_kinds()) {
    std::string why = kind.why_no_effect != nullptr ? kind.why_no_effect(prefix, link, part)
                                                    : why_off(kind, prefix, link, part);
    if (!why.empty()) return why;
  }
  return "";
}

}  // namespace tether
