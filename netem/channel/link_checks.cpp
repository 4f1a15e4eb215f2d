#include "netem/channel/link_checks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <limits>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"
#include "netem/link/jitter_laws.hpp"
#include "netem/models/kinds.hpp"

namespace tether {
namespace {

using Law = JitterConfig::Law;

/// Parts that do nothing while a switch of the same stage is off.
std::string why_stage_is_off(const std::string& prefix, const LinkConfig& link,
                             const std::string& part) {
  const auto is_zero = [&prefix](const char* key) { return fmt::format("{}{} is 0", prefix, key); };
  const JitterLaw& law = jitter_law(link.jitter.law);
  if (part.starts_with("jitter.") && part != "jitter.law" && !law.uses(part.substr(7))) {
    return fmt::format("{}jitter.law is \"{}\"", prefix, law.name);
  }
  if (part == "corrupt.bits" && link.corrupt.probability == 0.0) {
    return is_zero("corrupt.probability");
  }
  if (part == "reorder.gap" && link.reorder.probability == 0.0) {
    return is_zero("reorder.probability");
  }
  if (part.starts_with("rate.") && part != "rate.bits_per_s" && link.rate.bits_per_s == 0.0) {
    return is_zero("rate.bits_per_s");
  }
  if (part.starts_with("slot.") && part != "slot.period_ms" && link.slot.period_ms == 0.0) {
    return is_zero("slot.period_ms");
  }
  return "";
}

/// The stages.
class LinkChecker {
 public:
  explicit LinkChecker(const LoadedLink& loaded)
      : loaded_(loaded), prefix_(loaded.prefix), link_(loaded.link) {}

  void check() const {
    check_outages();
    check_jitter();
    if (link_.in_order && link_.reorder.probability > 0.0) {
      loaded_.refuse("{0}in_order = true and {0}reorder.probability = {1} contradict each other",
                     prefix_, link_.reorder.probability);
    }
    if (link_.slot.jitter_ms > link_.slot.period_ms) {
      loaded_.refuse("{0}slot.jitter_ms = {1} must not be above {0}slot.period_ms = {2}", prefix_,
                     link_.slot.jitter_ms, link_.slot.period_ms);
    }
  }

 private:
  void check_outages() const {
    double free_from = -std::numeric_limits<double>::infinity();
    for (const auto& outage : link_.outages) {
      if (outage.size() != 2 || !(outage[0] < outage[1]) || outage[0] < free_from) {
        loaded_.refuse("{}outages must be [[t1, t2], ...] with t1 < t2 <= the next t1", prefix_);
      }
      free_from = outage[1];
    }
  }

  void check_jitter() const {
    const JitterConfig& jitter = link_.jitter;
    const std::string key = prefix_ + "jitter.";
    if (jitter.law == Law::none || jitter.law == Law::constant) return;
    if (jitter.law == Law::table) {
      if (jitter.table_ms.empty() == jitter.file.empty()) {
        loaded_.refuse("{0}law = \"table\" needs one of {0}table_ms and {0}file", key);
      }
      const auto& table = jitter.table_ms;
      if (table.size() == 1 || !std::is_sorted(table.begin(), table.end())) {
        loaded_.refuse("{}table_ms must have two or more entries, none below the one before", key);
      }
      return;
    }
    if (jitter.sd_ms <= 0.0) {
      loaded_.refuse("{0}law = \"{1}\" needs {0}sd_ms > 0", key, jitter_law(jitter.law).name);
    }
    if (jitter.law == Law::gamma &&
        (jitter.mean_ms < 0.1 * jitter.sd_ms || jitter.mean_ms > 1e3 * jitter.sd_ms)) {
      loaded_.refuse(
          "{0}law = \"gamma\" needs {0}mean_ms in [sd_ms/10, 1000 sd_ms]; they are {1} and {2}",
          key, jitter.mean_ms, jitter.sd_ms);
    }
  }

  const LoadedLink& loaded_;
  const std::string& prefix_;
  const LinkConfig& link_;
};

void check_shared_state(const ChannelSettings& channel, const std::string& source) {
  const LinkConfig &uplink = channel.uplink, &downlink = channel.downlink;
  if (!channel.shared_state) return;
  const auto need = [&source](const std::string& what) {
    throw UsageError(fmt::format("{}: channel.shared_state = true needs {}", source, what));
  };
  if (uplink.model != downlink.model) need("the same model for uplink and downlink");
  const ChannelModelKind& kind = kind_of(uplink);
  const std::string missing =
      kind.not_shared != nullptr ? kind.not_shared(uplink, downlink) : std::string();
  if (!missing.empty()) need(missing);
  if (kind.moves(uplink) == ChannelModelKind::Moves::per_packet) {
    need(fmt::format("a model that moves in time: \"{}\" moves with each link's own packets",
                     kind.name));
  }
}

}  // namespace

std::string why_no_effect(const std::string& prefix, const LinkConfig& link,
                          const std::string& part) {
  const ChannelModelKind& kind = kind_of(link);
  std::string model_is = fmt::format("{}model is \"{}\"", prefix, kind.name);
  if (part == "prr" && !kind.uses_prr) return model_is;
  if (part == "delay_ms" && !kind.uses_delay_ms) return model_is;
  for (const ChannelModelKind& other : channel_model_kinds()) {
    if (!part.starts_with(other.name + ".")) continue;
    if (other.name != kind.name) return model_is;
    return kind.why_no_effect != nullptr ? kind.why_no_effect(prefix, link, part) : "";
  }
  return why_stage_is_off(prefix, link, part);
}

void resolve_link(const std::string& prefix, LinkConfig& link, const ScenarioLevel& level) {
  for (const ChannelModelKind& kind : channel_model_kinds()) {
    if (kind.resolve != nullptr) kind.resolve(prefix, link, level);
  }
}

std::string why_no_link_name(const std::string& name, const ChannelSettings& channel) {
  if (!is_identifier(name)) return "must be letters, digits, '-' and '_', at most 32";
  const auto upper = [](std::string text) {
    std::transform(text.begin(), text.end(), text.begin(),
                   [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
    return text;
  };
  const std::string report = upper(name);
  for (const char* taken : {"UPLINK", "DOWNLINK", "COUNTERS", "SET", "SETTINGS"}) {
    if (report == taken) return fmt::format("channel NET/{} has another meaning", taken);
  }
  for (const auto& [other, unused] : channel.links) {
    if (other == name || upper(other) != report) continue;
    return fmt::format("differs from \"{}\" only in case: both would report on NET/{}", other,
                       report);
  }
  return "";
}

void check_channel(const ChannelSettings& channel, const std::string& source) {
  channel.for_each_link([&source](const std::string& name, const LinkConfig& link) {
    const LoadedLink loaded{link, "channel." + name + ".", source};
    if (kind_of(link).check != nullptr) kind_of(link).check(loaded);
    LinkChecker(loaded).check();
  });
  check_shared_state(channel, source);
}

}  // namespace tether
