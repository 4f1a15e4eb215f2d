#include "netem/models/kinds.hpp"
#include "netem/models/state_process.hpp"

namespace tether {
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
