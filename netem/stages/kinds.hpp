#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/scenario/key_table.hpp"
#include "netem/link/link.hpp"
#include "netem/link/link_config.hpp"
#include "netem/link/link_field.hpp"
#include "netem/link/link_stage.hpp"
#include "netem/link/tc.hpp"
#include "netem/statistics/channel_expectation.hpp"

namespace tether {

/// Construction arguments of a stage of a link.
struct StageNeeds {
  const LinkConfig& link;
  std::string prefix;  ///< prefix of its keys, for messages
  LinkStreams streams;
  // Only for a link that is in use:
  const LinkConfig* before = nullptr;       ///< its settings until now
  const LinkStages* present = nullptr;      ///< its stages until now
  std::int64_t offered = 0;                 ///< packets so far
  Instant last_departure = Instant::min();  ///< last departure of the packets under way

  template <class Settings>
  const Settings& settings() const {
    return link.own.get<Settings>();
  }
  template <class Settings>
  bool same() const {
    return before != nullptr && before->own.get<Settings>() == settings<Settings>();
  }
  /// The present stage; null if it is off.
  template <class Stage>
  const Stage* present_as() const {
    if (present == nullptr) return nullptr;
    for (const StagePtr& stage : *present) {
      if (const auto* found = dynamic_cast<const Stage*>(stage.get())) return found;
    }
    return nullptr;
  }
  /// A stage that is on. One that was on goes on with its stream and what it remembers, under
  /// set(settings); one that is switched on passes over the draws of the packets so far by
  /// skip(packets) (about 1 ns for each), if it has that.
  template <class Stage>
  StagePtr go_on() const {
    const auto& own = settings<typename Stage::Settings>();
    if (const auto* old = present_as<Stage>()) {
      auto stage = std::make_unique<Stage>(*old);
      stage->set(own);
      return stage;
    }
    auto stage = std::make_unique<Stage>(own, streams);
    if constexpr (requires { stage->skip(offered); }) stage->skip(offered);
    return stage;
  }
};

/// Traffic through a link.
struct LinkTraffic {
  double interval_s = 1.0;    ///< between packets; the shortest one if they come irregularly
  double packet_bytes = 0.0;  ///< size of each packet
  bool periodic = true;       ///< never two packets within less than interval_s
  /// Empty, or why packets meet some states of the channel more often than time would have it.
  std::string selected_because = {};
};

/// Effect of the stages on the expected statistics of the model's packets. A delay is
/// service_s + max(0, the model's + jitter), or in a share of packets service_s alone.
struct StageEffects {
  double loss = 0.0;  ///< independent of all else
  double service_s = 0.0;
  DelayCdf jitter = {};           ///< P[jitter <= x]; empty: there is none
  double share_that_skips = 0.0;  ///< the model's delay and the jitter
  double delay_vif = 0.0;         ///< ChannelExpectation::add_delay_vif()
  std::string no_delays = {};     ///< why delays are open, or ""
  std::string keeps_order = {};   ///< why they are open if delays differ, or ""
};

/// One of a link's stages. A new one is a file with a function <name>_stage() that returns its row,
/// and a line in kinds.cpp. Its settings are a struct with operator== in LinkConfig::own, at
/// link.own.get<Settings>(), and known only to its own file.
struct LinkStageKind {
  std::string name = {};
  bool (*on)(const LinkConfig&) = nullptr;  ///< null: always
  /// Makes an enabled stage. Must be given. Throws UsageError.
  StagePtr (*make)(const StageNeeds&) = nullptr;

  /// field.keys_of<Settings>("<name>"), or ("") for the link's own keys, which have no dot.
  std::vector<ScenarioKey> (*keys)(const LinkField& field) = nullptr;
  /// The key that goes without saying in the resolved scenario at its default, behind the prefix.
  std::string switch_key = {};
  /// Why `part`, the key behind the link's prefix, does nothing; "" if it has an effect. Null:
  /// where it is off, other keys in the switch's table do nothing: "<prefix><switch key> is 0".
  std::string (*why_no_effect)(const std::string& prefix, const LinkConfig&,
                               const std::string& part) = nullptr;
  /// Checks conditions on several keys together. Throws UsageError: link.refuse().
  void (*check)(const LoadedLink& link) = nullptr;

  /// Expectation of `tether netem check`. Null: nothing that it checks. Called in the order of the
  /// stages, whether the stage is on or not.
  void (*expect)(const LinkConfig&, const LinkTraffic&, StageEffects&) = nullptr;

  /// tc: appends its option or a note. Null: nothing to say. Called whether it is on or not.
  void (*export_tc)(const LinkConfig&, const TcSender&, TcDraft&) = nullptr;
  TcPart tc_part = TcPart::schedule;
};

/// All stages, in the order in which packets pass them, and of their keys.
///   1. state: lost with probability 1 − PRR of what the channel's model says;
///   2. room: dropped if too many packets or bytes are under way;
///   3. outages: during one, nothing enters the link;
///   4. loss: independent;
///   5. corrupt: some bits are flipped;
///   6. duplicate: a copy goes the same way, right behind;
///   7. rate: waits for a bottleneck, or is dropped at its full queue;
///   8. jitter: a random delay beside the model's; a copy has one of its own;
///   9. reorder: now and then a packet skips the delay;
///  10. in_order: none leaves before those offered earlier; without it, packets overtake each other
///      when delays fall;
///  11. slots: waits for the next release.
const std::vector<LinkStageKind>& link_stage_kinds();

/// Makes the enabled stages. Reads files. Throws UsageError.
///
/// Of a link in use, from packet number `offered` on:
/// - What a stage's stream has in store for the n-th packet stays what it is, whichever stages are
///   switched on, off or changed.
/// - Stages whose settings are the same stay as they are. Those that remember earlier packets keep
///   their memory under new settings: the bottleneck its queue, correlated jitter the last packet's
///   normal score, reordering its gap. Only slots forget who had places in them. With in_order no
///   packet overtakes those that are under way, whatever they were offered under.
LinkStages make_stages(const StageNeeds& needs);

/// Stages of a new link.
LinkStages make_stages(const LinkConfig& link, const std::string& prefix,
                       const LinkStreams& streams);

/// Stages of a link in use that had the settings `before`.
LinkStages renewed_stages(const Link& link, const LinkConfig& before, const LinkConfig& after,
                          const std::string& prefix, const LinkStreams& streams);

/// LinkStageKind::why_no_effect of one of the stages; "" if `part` is of none or has an effect.
std::string why_no_effect_on_stages(const std::string& prefix, const LinkConfig& link,
                                    const std::string& part);

}  // namespace tether
