#include "netem/models/four_state.hpp"

#include "netem/models/kinds.hpp"

namespace tether {
namespace {

int next_state(const FourState& m, int state, double luck) {
  switch (state) {
    case 1:
      if (luck < m.p14) return 4;
      return luck < m.p14 + m.p13 ? 3 : 1;
    case 2:
      return luck < m.p23 ? 3 : 2;
    case 3:
      if (luck < m.p32) return 2;
      return luck < m.p32 + m.p31 ? 1 : 3;
    default:
      return 1;
  }
}

const FourStateConfig& of(const LinkConfig& link) { return link.own.get<FourStateConfig>(); }

FourState model_of(const LinkConfig& link) {
  const FourStateConfig& c = of(link);
  const double p13 = c.p13.value_or(0.0);
  return {p13, c.p31.value_or(1.0 - p13), c.p32, c.p23, c.p14};
}

std::vector<ScenarioKey> keys(const LinkField& field) {
  using Config = FourStateConfig;
  auto t = field.keys_of<Config>("four_state");
  t.optional_number("p13", &Config::p13, kRatio, "gap to burst loss");
  t.optional_number("p31", &Config::p31, kRatio, "burst loss to gap; 1 - p13 if not given");
  t.number("p32", &Config::p32, kRatio, "burst loss to received in burst");
  t.number("p23", &Config::p23, kRatio, "received in burst to burst loss");
  t.number("p14", &Config::p14, kRatio, "gap to isolated loss");
  return t.take();
}

void check(const LoadedLink& loaded) {
  const std::string key = loaded.prefix + "four_state.";
  if (!of(loaded.link).p13) {
    loaded.refuse("{0}model = \"four_state\" needs {1}p13", loaded.prefix, key);
  }
  const FourState m = model_of(loaded.link);
  if (m.p13 + m.p14 > 1.0 + kProbabilityRounding) {
    loaded.refuse("{0}p13 + p14 = {1} must not be above 1: both leave state 1", key, m.p13 + m.p14);
  }
  if (m.p31 + m.p32 > 1.0 + kProbabilityRounding) {
    loaded.refuse(
        "{0}p31 + p32 = {1} must not be above 1: both leave state 3 (p31 is 1 - p13 if not given)",
        key, m.p31 + m.p32);
  }
}

void export_loss(const LinkConfig& link, const TcSender&, TcDraft& out) {
  const FourState m = model_of(link);
  out.command += fmt::format(" loss state {} {} {} {} {}", tc_percent(m.p13), tc_percent(m.p31),
                             tc_percent(m.p32), tc_percent(m.p23), tc_percent(m.p14));
  if (out.loss == 0.0) return;
  out.notes.push_back(fmt::format(
      "loss = {:g} is left out: one netem has one loss model; a second one, as its child, would "
      "have it",
      out.loss));
}

}  // namespace

FourStateProcess::FourStateProcess(const FourState& model, Duration delay, RandomEngine random)
    : model_(model), delay_(delay), random_(random) {}

FourStateProcess::FourStateProcess(const FourState& model, Duration delay,
                                   const FourStateProcess& before)
    : model_(model), delay_(delay), random_(before.random_), state_(before.state_) {}

LinkCondition FourStateProcess::on_packet(Instant) {
  state_ = next_state(model_, state_, uniform_01(random_));
  return condition();
}

LinkCondition FourStateProcess::condition() const { return {state_ <= 2 ? 1.0 : 0.0, delay_}; }

ChannelExpectation expect_four_state(const FourState& m, DelayCdf delay) {
  return ChannelExpectation::chain({{1.0 - m.p13 - m.p14, 0.0, m.p13, m.p14},
                                    {0.0, 1.0 - m.p23, m.p23, 0.0},
                                    {m.p31, m.p32, 1.0 - m.p31 - m.p32, 0.0},
                                    {1.0, 0.0, 0.0, 0.0}},
                                   {{"received in a gap", 1.0, delay},
                                    {"received in a burst", 1.0, delay},
                                    {"lost in a burst", 0.0, delay},
                                    {"lost alone", 0.0, delay}});
}

ChannelModelKind four_state_model() {
  ChannelModelKind kind{.name = "four_state",
                        .uses_delay_ms = true,
                        .begins_in_first = true,
                        .keys = keys,
                        .check = check};
  kind.moves = [](const LinkConfig&) { return ChannelModelKind::Moves::per_packet; };
  kind.make = [](const ProcessNeeds& needs) {
    return needs.per_packet<FourStateProcess>(model_of(needs.link));
  };
  kind.expect = [](const LinkConfig& link, const ExpectedPackets& packets) {
    return expect_four_state(model_of(link), packets.delay(link.fixed.delay_ms));
  };
  kind.only_delay_ms = own_delay_ms;
  kind.export_loss = export_loss;
  return kind;
}

}  // namespace tether
