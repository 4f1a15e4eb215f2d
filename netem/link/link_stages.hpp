#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string_view>
#include <vector>

#include "common/base/random.hpp"
#include "netem/link/delay_law.hpp"
#include "netem/link/link_config.hpp"
#include "netem/link/packet_models.hpp"

namespace tether {

/// A random stream of one link for one purpose, such as "loss".
using LinkStreams = std::function<RandomEngine(std::string_view purpose)>;

/// The stages of a link (link.hpp has their order), made from its settings, each with a stream of
/// its own. A value: copies go on from where the original is, on their own.
class LinkStages {
 public:
  /// What the stages' streams have in store for one packet.
  struct Luck {
    bool lost = false;
    Corruption::Damage damage;
    bool duplicate = false;
    Duration jitter{0};
    Duration copy_jitter{0};
    bool skips_delay = false;
  };

  /// `delay_table_ms`: load_delay_table(config.jitter).
  LinkStages(const LinkConfig& config, const LinkStreams& streams,
             const std::vector<double>& delay_table_ms);

  /// The stages under other settings, from packet number `offered` on.
  ///
  /// - What a stage's stream has in store for the n-th packet stays what it is, whichever stages
  ///   are switched on, off or changed: streams of stages that are on go on, those of stages that
  ///   are switched on pass over the draws of the packets so far (about 1 ns for each).
  /// - Stages whose settings are the same stay as they are. Those that remember earlier packets
  ///   keep their memory under new settings: the bottleneck its queue, correlated jitter the last
  ///   packet's normal score, reordering its gap. Only slots forget who had places in them.
  ///
  /// `delay_table_ms` is used only if config.jitter is not the old one.
  LinkStages renewed(const LinkConfig& config, const LinkStreams& streams,
                     const std::vector<double>& delay_table_ms, std::int64_t offered) const;

  /// For the next packet, which gets through the channel with probability `prr`.
  Luck draw(double prr);

  LinkConfig config;
  OutageSchedule outages;
  std::optional<Corruption> corruption;
  std::optional<RateLimit> rate;
  std::optional<SlotSchedule> slots;

 private:
  void switch_on(const LinkStreams& streams, std::int64_t offered);
  void set_jitter(const LinkStreams& streams, const std::vector<double>& delay_table_ms,
                  std::int64_t offered, bool law_is_new);

  RandomEngine state_loss_;
  std::optional<Coin> loss_;
  std::optional<Coin> duplication_;
  std::optional<DelaySequence> jitter_;
  std::optional<DelaySequence> copy_jitter_;
  std::optional<Reordering> reordering_;
};

}  // namespace tether
