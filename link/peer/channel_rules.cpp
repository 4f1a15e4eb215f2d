#include "link/peer/channel_rules.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"

namespace tether::link {
namespace {

constexpr char kSameName[] = "$&";

[[noreturn]] void refuse(const std::string& rule, const std::string& why) {
  throw UsageError(
      fmt::format("\"{}\": {} (such as \"CTRL/(CMD_VEL|PLAN) -> AGV/$1\")", rule, why));
}

/// "REGEX", and what is behind the arrow.
std::pair<std::string, std::string> parts_of(const std::string& rule) {
  for (const std::string arrow : {"→", "->"}) {
    const auto at = rule.find(arrow);
    if (at == std::string::npos) continue;
    const std::string_view all = rule;
    const std::string rename(trimmed(all.substr(at + arrow.size())));
    if (rename.empty()) refuse(rule, "nothing behind the arrow");
    return {std::string(trimmed(all.substr(0, at))), rename};
  }
  return {std::string(trimmed(rule)), kSameName};
}

void check_rename(const std::string& rule, const std::string& rename, std::size_t groups) {
  for (auto at = rename.find('$'); at != std::string::npos; at = rename.find('$', at + 2)) {
    const std::string next = rename.substr(at + 1, 1);
    if (next == "$" || next == "&") continue;
    std::string digits = rename.substr(at + 1, 2);
    digits.resize(std::min(digits.find_first_not_of("0123456789"), digits.size()));
    const std::size_t number = to_number<std::size_t>(digits).value_or(0);
    if (number >= 1 && number <= groups) continue;
    refuse(rule, fmt::format("the ${} of its name means nothing: the pattern has {} groups", next,
                             groups));
  }
}

}  // namespace

SendRules::SendRules(const std::vector<std::string>& rules) {
  for (const std::string& rule : rules) {
    const auto [pattern, rename] = parts_of(rule);
    if (pattern.empty()) refuse(rule, "no pattern of channels");
    rules_.push_back({Pattern(pattern), rename});
    check_rename(rule, rename, rules_.back().pattern.group_count());
  }
}

std::optional<std::string> SendRules::name_of(std::string_view channel) const {
  for (const Rule& rule : rules_) {
    if (rule.rename != kSameName) {
      if (auto name = rule.pattern.replaced(channel, rule.rename)) return name;
    } else if (rule.pattern.matches(channel)) {
      return std::string(channel);
    }
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
