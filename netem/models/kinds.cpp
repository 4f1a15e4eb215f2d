#include "netem/models/kinds.hpp"

#include <algorithm>
#include <stdexcept>

#include "netem/models/state_process.hpp"

namespace tether {

#define TETHER_CHANNEL_MODELS(MODEL) \
  MODEL(fixed)                       \
  MODEL(markov)                      \
  MODEL(gilbert_elliott)             \
  MODEL(four_state)                  \
  MODEL(chain)                       \
  MODEL(trace)                       \
  MODEL(map)

#define TETHER_DECLARE(name) ChannelModelKind name##_model();
TETHER_CHANNEL_MODELS(TETHER_DECLARE)
#undef TETHER_DECLARE

const std::vector<ChannelModelKind>& channel_model_kinds() {
#define TETHER_ROW(name) name##_model(),
  static const std::vector<ChannelModelKind> kinds{TETHER_CHANNEL_MODELS(TETHER_ROW)};
#undef TETHER_ROW
  return kinds;
}

const ChannelModelKind& kind_of(const LinkConfig& link) {
  for (const ChannelModelKind& kind : channel_model_kinds()) {
    if (kind.name == link.model) return kind;
  }
  throw std::logic_error("no such channel model: " + link.model);
}

std::string describe_model(const LinkConfig& link) {
  const ChannelModelKind& kind = kind_of(link);
  return kind.describe != nullptr ? kind.describe(link) : kind.name;
}

RandomEngine ProcessNeeds::packet_stream() const {
  RandomEngine random = streams("state");
  random.discard(static_cast<std::uint64_t>(offered));
  return random;
}

LinkCondition condition_of(const ChannelStateConfig& state) {
  return {state.prr, from_seconds(state.delay_ms * 1e-3)};
}

std::optional<double> own_delay_ms(const LinkConfig& link) { return link.fixed.delay_ms; }

namespace {

void export_loss(const LinkConfig& link, const TcSender&, TcDraft& out) {
  out.command += tc_random_loss(loss_of_either(1.0 - link.fixed.prr, out.loss));
}

}  // namespace

ChannelModelKind fixed_model() {
  ChannelModelKind kind{.name = "fixed", .uses_prr = true, .uses_delay_ms = true};
  kind.moves = [](const LinkConfig&) { return ChannelModelKind::Moves::never; };
  kind.describe = [](const LinkConfig& link) {
    return fmt::format("PRR {:g}, δ {:g} ms", link.fixed.prr, link.fixed.delay_ms);
  };
  kind.make = [](const ProcessNeeds& needs) -> ProcessPtr {
    return std::make_shared<FixedProcess>(condition_of(needs.link.fixed));
  };
  kind.expect = [](const LinkConfig& link, const ExpectedPackets& packets) {
    return ChannelExpectation::independent(link.fixed.prr, packets.delay(link.fixed.delay_ms));
  };
  kind.only_delay_ms = own_delay_ms;
  kind.export_loss = export_loss;
  return kind;
}

}  // namespace tether
