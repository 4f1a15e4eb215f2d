#include "link/peer/channel_rules.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"

namespace tether::link {

SendRules::SendRules(const std::vector<std::string>& rules) {
  for (const std::string& rule : rules) {
    try {
      const auto [pattern, rename] =
          split_at_arrow(rule).value_or(std::pair{std::string(trimmed(rule)), std::string("$&")});
      if (pattern.empty()) throw UsageError("no pattern of channels");
      if (rename.empty()) throw UsageError("nothing behind the arrow");
      rules_.push_back({Pattern(pattern), rename});
      rules_.back().pattern.check_replacement(rename);
    } catch (const UsageError& error) {
      throw UsageError(fmt::format("\"{}\": {} (such as \"CTRL/(CMD_VEL|PLAN) -> AGV/$1\")", rule,
                                   error.what()));
    }
  }
}

std::optional<std::string> SendRules::name_of(std::string_view channel) const {
  for (const Rule& rule : rules_) {
    if (auto name = rule.pattern.replaced(channel, rule.rename)) return name;
  }
  return std::nullopt;
}

ChannelList::ChannelList(const std::vector<std::string>& patterns)
    : patterns_(patterns.begin(), patterns.end()) {}

bool ChannelList::has(std::string_view channel) const {
  return std::any_of(patterns_.begin(), patterns_.end(),
                     [channel](const Pattern& p) { return p.matches(channel); });
}

}  // namespace tether::link
