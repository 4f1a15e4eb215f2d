#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/pattern.hpp"
#include "common/scenario/scenario.hpp"
#include "netem/channel/use.hpp"

namespace tether {

/// Rule of tether-netem for messages of other programs, one `--rule`:
///
///     [SRC_URL:]REGEX → [DST_URL:]RENAME via LINK        (or ->)
///
/// Whatever appears on SRC_URL under a channel that REGEX matches as a whole
/// (common/base/pattern.hpp) leaves on DST_URL as RENAME ($1 … for what the groups matched, $& for
/// all) when it has passed LINK. Without a URL: the relay's own network. Without RENAME (DST_URL
/// alone): under the same name.
///
/// A part that begins with "udpm://" is a URL up to its second colon, the one before the port being
/// the first; everything behind it is the pattern, colons too. The arrow stands there once.
struct RelayRule {
  std::string source_url;  ///< a URL in the form of checked_lcm_url(), here and below
  std::string pattern;
  std::string destination_url;
  std::string rename;  ///< "$&": the same name
  std::string link;    ///< "uplink", "downlink" or one of [channel.links]
};

/// Reads rules for a relay on `own_url`. Throws UsageError, one line that names the rule, for what
/// does not follow the grammar above; for links that `scenario` does not have, or whose model needs
/// the vehicle's position; for a rule that turns a network's channel into itself; and for networks
/// that LCM cannot tell apart.
std::vector<RelayRule> parse_relay_rules(const std::vector<std::string>& texts,
                                         const std::string& own_url, const NetemSettings& settings);

/// The links that the rules use, in their order.
ChannelUse use_of(const std::vector<RelayRule>& rules);

/// The rule as it was understood, on a line.
std::string to_text(const RelayRule& rule);

/// "239.255.76.67:7667": what tells LCM networks apart.
std::string network_address(const std::string& url);

/// Mapping of channel names by a rule.
class ChannelMap {
 public:
  explicit ChannelMap(const RelayRule& rule);

  /// The name under which messages of `channel` leave; nullopt if the rule is not about them.
  std::optional<std::string> map(std::string_view channel) const;

 private:
  Pattern pattern_;
  std::string rename_;
};

}  // namespace tether
