#include "netem/models/markov.hpp"

#include <array>
#include <cmath>

#include "netem/models/gilbert_elliott.hpp"
#include "netem/models/kinds.hpp"
#include "netem/models/state_process.hpp"

namespace tether {
namespace {

constexpr Range kSojourn{1e-3, 1e9, false};

const MarkovConfig& of(const LinkConfig& link) { return link.own.get<MarkovConfig>(); }

bool same_times(const MarkovConfig& a, const MarkovConfig& b) {
  return a.mean_good_s == b.mean_good_s && a.mean_bad_s == b.mean_bad_s;
}

std::vector<ScenarioKey> keys(const LinkField& field) {
  auto t = field.keys_of<MarkovConfig>("markov");
  t.number("good.prr", TETHER_MEMBER(good.prr), kRatio, "packet reception ratio in the good state");
  t.number("good.delay_ms", TETHER_MEMBER(good.delay_ms), kDelayRange_ms,
           "delay in the good state");
  t.number("bad.prr", TETHER_MEMBER(bad.prr), kRatio, "packet reception ratio in the bad state");
  t.number("bad.delay_ms", TETHER_MEMBER(bad.delay_ms), kDelayRange_ms, "delay in the bad state");
  t.number("mean_good_s", &MarkovConfig::mean_good_s, kSojourn,
           "mean sojourn time in the good state");
  t.number("mean_bad_s", &MarkovConfig::mean_bad_s, kSojourn, "mean sojourn time in the bad state");
  t.optional_number("p_bad", &MarkovConfig::p_bad, {1e-6, 1.0 - 1e-6, false},
                    "instead of the sojourn times: stationary probability of the bad state ...");
  t.optional_number("mean_cycle_s", &MarkovConfig::mean_cycle_s, kSojourn,
                    "... and mean time from one bad spell to the next");
  return t.take();
}

/// p_bad and mean_cycle_s to sojourn times.
void resolve(const std::string& prefix, LinkConfig& link, const ScenarioLevel& level) {
  const MarkovConfig given = of(link);
  if (!given.p_bad && !given.mean_cycle_s) return;
  const std::string stationary = fmt::format("{0}markov.p_bad and {0}markov.mean_cycle_s", prefix);
  if (level.has(prefix + "markov.mean_good_s") || level.has(prefix + "markov.mean_bad_s")) {
    throw UsageError(fmt::format("{}: give either {}, or {}markov.mean_good_s and mean_bad_s",
                                 level.source, stationary, prefix));
  }
  // One of the two alone keeps the other as it was.
  const double old_cycle_s = given.mean_good_s + given.mean_bad_s;
  const double cycle_s = given.mean_cycle_s.value_or(old_cycle_s);
  const double mean_bad_s = given.p_bad.value_or(given.mean_bad_s / old_cycle_s) * cycle_s;
  level.set_derived(prefix + "markov.mean_bad_s", mean_bad_s, stationary);
  level.set_derived(prefix + "markov.mean_good_s", cycle_s - mean_bad_s, stationary);
  auto& markov = link.own.get<MarkovConfig>();
  markov.p_bad.reset();
  markov.mean_cycle_s.reset();
}

ProcessPtr make(const ProcessNeeds& needs) {
  const MarkovConfig& c = of(needs.link);
  const bool keep = needs.same_model() && same_times(of(*needs.before), c);
  const auto other = needs.with_clock<MarkovProcess>(keep);
  const auto clock = other ? other->clock()
                           : needs.moved_on(StateProcess::markov(c.mean_good_s, c.mean_bad_s,
                                                                 needs.streams("state")));
  return std::make_shared<MarkovProcess>(clock,
                                         std::array{condition_of(c.good), condition_of(c.bad)});
}

void export_loss(const LinkConfig& link, const TcSender& sender, TcDraft& out) {
  const MarkovConfig& c = of(link);
  const auto [p, r] = markov_step(c.mean_good_s, c.mean_bad_s, sender.interval_s);
  out.notes.push_back(fmt::format(
      "model = \"markov\" has no equivalent: netem's states step with packets, not with time; as "
      "long as packets come every {:g} ms, \"{}\" has the same loss",
      sender.interval_s * 1e3,
      tc_gemodel({p, r, 1.0 - c.bad.prr, 1.0 - c.good.prr}, out.loss).substr(1)));
}

}  // namespace

TwoStateStep markov_step(double mean_good_s, double mean_bad_s, double interval_s) {
  const double p_bad = mean_bad_s / (mean_good_s + mean_bad_s);
  const double a = -std::expm1(-interval_s * (1.0 / mean_good_s + 1.0 / mean_bad_s));
  return {p_bad * a, (1.0 - p_bad) * a};
}

ChannelExpectation expect_markov(double mean_good_s, double mean_bad_s, double interval_s,
                                 ExpectedState good, ExpectedState bad) {
  const auto [p, r] = markov_step(mean_good_s, mean_bad_s, interval_s);
  return ChannelExpectation::in_time({{1.0 - p, p}, {r, 1.0 - r}},
                                     {std::move(good), std::move(bad)}, {mean_good_s, mean_bad_s});
}

ChannelModelKind markov_model() {
  ChannelModelKind kind{.name = "markov", .keys = keys, .resolve = resolve};
  kind.not_shared = [](const LinkConfig& up, const LinkConfig& down) -> std::string {
    if (same_times(of(up), of(down))) return "";
    return "the same sojourn times for uplink and downlink (set channel.markov.… for both)";
  };
  kind.moves = [](const LinkConfig&) { return ChannelModelKind::Moves::in_time; };
  kind.describe = [](const LinkConfig& link) {
    const MarkovConfig& c = of(link);
    return fmt::format("Markov, PRR {:g}/{:g}, δ {:g}/{:g} ms", c.good.prr, c.bad.prr,
                       c.good.delay_ms, c.bad.delay_ms);
  };
  kind.make = make;
  kind.expect = [](const LinkConfig& link, const ExpectedPackets& packets) {
    const MarkovConfig& c = of(link);
    return expect_markov(c.mean_good_s, c.mean_bad_s, packets.interval_s,
                         {"good", c.good.prr, packets.delay(c.good.delay_ms)},
                         {"bad", c.bad.prr, packets.delay(c.bad.delay_ms)});
  };
  kind.only_delay_ms = [](const LinkConfig& link) -> std::optional<double> {
    const MarkovConfig& c = of(link);
    if (c.good.delay_ms != c.bad.delay_ms) return std::nullopt;
    return c.good.delay_ms;
  };
  kind.export_loss = export_loss;
  return kind;
}

}  // namespace tether
