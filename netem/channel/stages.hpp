#pragma once

#include <string>
#include <vector>

#include "common/scenario/key_table.hpp"
#include "netem/link/link_config.hpp"
#include "netem/models/kinds.hpp"

namespace tether {

/// One of a link's stages (netem/link/link.hpp), as scenarios have it: a row in stages.cpp.
struct LinkStageKind {
  /// Its keys that are the link's own, which come before those of models …
  void (*link_keys)(KeyTable<LinkConfig>&) = nullptr;
  /// … and those in a table of its own, which come behind them.
  void (*keys)(KeyTable<LinkConfig>&) = nullptr;
  /// Its switch, which goes without saying in the resolved scenario at its default.
  std::string switch_key = {};
  /// Why `part`, the key behind the link's prefix, does nothing; "" if it has an effect.
  std::string (*why_no_effect)(const std::string& prefix, const LinkConfig&,
                               const std::string& part) = nullptr;
  /// What several keys together must fulfil. Throws UsageError: link.refuse().
  void (*check)(const LoadedLink& link) = nullptr;
};

/// All stages, in the order of their keys.
const std::vector<LinkStageKind>& link_stage_kinds();

}  // namespace tether
