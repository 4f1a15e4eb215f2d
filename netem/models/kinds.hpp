#pragma once

#include <fmt/format.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/random.hpp"
#include "netem/link/channel_process.hpp"
#include "netem/link/link_config.hpp"
#include "netem/link/link_field.hpp"
#include "netem/link/link_stage.hpp"
#include "netem/link/tc.hpp"
#include "netem/statistics/channel_expectation.hpp"

namespace tether {

/// Rounding of probabilities written in decimal.
inline constexpr double kProbabilityRounding = 1e-9;

using ProcessPtr = std::shared_ptr<ChannelProcess>;

/// Construction arguments of a link's process.
struct ProcessNeeds {
  const LinkConfig& link;
  std::string prefix;   ///< prefix of its keys, for messages
  LinkStreams streams;  ///< the link's own
  std::uint64_t seed;   ///< for streams that are not the link's own
  /// Process of the other direction, whose state this one must have; null: none.
  ProcessPtr shared = {};
  // Only for a link that is in use:
  const LinkConfig* before = nullptr;  ///< its settings until now
  ProcessPtr present = {};             ///< its process until now
  std::int64_t offered = 0;            ///< packets so far
  Instant now{};

  /// Whether the link had this model until now.
  bool same_model() const { return before != nullptr && before->model == link.model; }
  template <class Settings>
  bool same() const {
    return same_model() && before->own.get<Settings>() == link.own.get<Settings>();
  }
  /// The present process; null if that is of another type.
  template <class Process>
  std::shared_ptr<Process> present_as() const {
    return std::dynamic_pointer_cast<Process>(present);
  }
  /// The process that has the clock to go on with: the other direction's, or its own if `keep`;
  /// null if there is none.
  template <class Process>
  std::shared_ptr<Process> with_clock(bool keep) const {
    if (shared) return std::dynamic_pointer_cast<Process>(shared);
    return keep ? present_as<Process>() : nullptr;
  }
  /// A clock that was made again, as if it had been in use from the start.
  template <class Clock>
  std::shared_ptr<Clock> moved_on(Clock clock) const {
    if (before != nullptr) clock.advance(now);
    return std::make_shared<Clock>(std::move(clock));
  }
  /// The stream "state" of a process with one draw per packet, from the next packet's on.
  RandomEngine packet_stream() const;
  /// A process per packet, which goes on from the present one if that is of the same type.
  template <class Process, class Model>
  ProcessPtr per_packet(const Model& model) const {
    const Duration delay = from_seconds(link.fixed.delay_ms * 1e-3);
    if (const auto old = present_as<Process>()) {
      return std::make_shared<Process>(model, delay, *old);
    }
    return std::make_shared<Process>(model, delay, packet_stream());
  }
};

/// The packets that an expectation is about.
struct ExpectedPackets {
  double interval_s = 1.0;  ///< between packets; the shortest one if they come irregularly
  /// The law of all delay of packets that the model delays by so much.
  std::function<DelayCdf(double delay_ms)> delay;
};

/// One of the values of channel.<link>.model. A new one is a file with a function <name>_model()
/// that returns its row, and a line in kinds.cpp. Its settings are a struct with operator== in
/// LinkConfig::own, at link.own.get<Settings>(), and known only to its own file.
struct ChannelModelKind {
  enum class Moves { never, in_time, per_packet };

  std::string name;       ///< its own keys begin with this and a dot
  bool uses_prr = false;  ///< the link's own key prr
  bool uses_delay_ms = false;
  bool needs_position = false;   ///< the vehicle's
  bool begins_in_first = false;  ///< the first of its states, whether it ever returns to it or not

  /// Its own keys: field.keys_of<Settings>(name).
  std::vector<ScenarioKey> (*keys)(const LinkField& field) = nullptr;
  /// At the end of each level, whichever model the link has: turns keys that stand for others into
  /// these. Throws UsageError.
  void (*resolve)(const std::string& prefix, LinkConfig&, const ScenarioLevel&) = nullptr;
  /// Checks conditions on several keys together. Throws UsageError: link.refuse().
  void (*check)(const LoadedLink& link) = nullptr;
  /// Why one of its own keys, `part` = "<name>.…", does nothing; "" if it has an effect.
  std::string (*why_no_effect)(const std::string& prefix, const LinkConfig&,
                               const std::string& part) = nullptr;
  /// Checks the conditions of channel.shared_state on two links: "the same …"; "" if all is well.
  std::string (*not_shared)(const LinkConfig& uplink, const LinkConfig& downlink) = nullptr;
  Moves (*moves)(const LinkConfig&) = nullptr;  ///< must be given
  /// In a few words, for figures; null: its name.
  std::string (*describe)(const LinkConfig&) = nullptr;

  /// Throws UsageError for what is wrong with its files and matrices.
  ProcessPtr (*make)(const ProcessNeeds&) = nullptr;  ///< must be given

  /// Expectation of `tether netem check`. Throws UsageError if packets that come at this interval
  /// always meet the same phase of it. Null for models without an expectation, with the reason.
  ChannelExpectation (*expect)(const LinkConfig&, const ExpectedPackets&) = nullptr;
  std::string why_open = {};

  /// tc: the delay in all states; nullopt if it differs. Null: unknown.
  std::optional<double> (*only_delay_ms)(const LinkConfig&) = nullptr;
  /// tc: appends ` loss …`, with TcDraft::loss composed, and notes what has no equivalent.
  void (*export_loss)(const LinkConfig&, const TcSender&, TcDraft&) = nullptr;  ///< must be given
};

/// All models, in the order in which messages name them and keys are listed.
const std::vector<ChannelModelKind>& channel_model_kinds();
const ChannelModelKind& kind_of(const LinkConfig& link);

/// In a few words, for figures.
std::string describe_model(const LinkConfig& link);

// For rows.

LinkCondition condition_of(const ChannelStateConfig& state);
/// The link's own delay.
std::optional<double> own_delay_ms(const LinkConfig& link);

/// ChannelModelKind::not_shared of models whose settings must all be the same.
template <class Settings>
std::string same_settings(const LinkConfig& uplink, const LinkConfig& downlink) {
  if (uplink.own.get<Settings>() == downlink.own.get<Settings>()) return "";
  return fmt::format("the same {0} for uplink and downlink (set channel.{0}.… for both)",
                     uplink.model);
}

}  // namespace tether
