#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/pattern.hpp"

namespace tether::link {

/// Which channels go to a peer, and under which names: rules
///
///     REGEX            as they are
///     REGEX -> RENAME  (or →) $1 … for what the groups matched, $& for all
///
/// whose REGEX (common/base/pattern.hpp) must match a channel's whole name. The first that does
/// counts.
class SendRules {
 public:
  SendRules() = default;
  /// Throws UsageError that quotes the rule.
  explicit SendRules(const std::vector<std::string>& rules);

  /// The name at the peer; nullopt: this channel stays here.
  std::optional<std::string> name_of(std::string_view channel) const;

 private:
  struct Rule {
    Pattern pattern;
    std::string rename;
  };
  std::vector<Rule> rules_;
};

/// A list of channels: those whose whole name one of its patterns matches.
class ChannelList {
 public:
  ChannelList() = default;
  /// Throws UsageError that quotes the pattern.
  explicit ChannelList(const std::vector<std::string>& patterns);

  bool has(std::string_view channel) const;

 private:
  std::vector<Pattern> patterns_;
};

}  // namespace tether::link
