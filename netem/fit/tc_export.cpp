#include "netem/fit/tc_export.hpp"

#include <fmt/format.h>

#include "netem/models/kinds.hpp"
#include "netem/stages/kinds.hpp"

namespace tether {
namespace {

void export_stages(TcPart part, const LinkConfig& link, const TcSender& sender, TcDraft& out) {
  for (const LinkStageKind& stage : link_stage_kinds()) {
    if (stage.export_tc != nullptr && stage.tc_part == part) stage.export_tc(link, sender, out);
  }
}

}  // namespace

TcExport export_tc(const LinkConfig& link, const TcSender& sender) {
  const ChannelModelKind& model = kind_of(link);
  TcDraft out;
  out.command = fmt::format("tc qdisc add dev {} root netem", sender.interface);
  const auto delay_ms =
      model.only_delay_ms != nullptr ? model.only_delay_ms(link) : std::optional(0.0);
  out.state_delay_ms = delay_ms.value_or(0.0);
  if (!delay_ms) {
    out.notes.emplace_back(
        "delays that depend on the state have no equivalent: the states' delays are left out");
  }
  for (const TcPart part : kTcParts) {
    export_stages(part, link, sender, out);
    if (part == TcPart::loss) model.export_loss(link, sender, out);
  }
  return out;
}

}  // namespace tether
