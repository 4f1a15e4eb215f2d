#include "netem/models/gilbert_elliott.hpp"

#include <algorithm>
#include <utility>

#include "netem/models/kinds.hpp"

namespace tether {
namespace {

const GilbertElliottConfig& of(const LinkConfig& link) {
  return link.own.get<GilbertElliottConfig>();
}

GilbertElliott model_of(const LinkConfig& link) {
  const GilbertElliottConfig& c = of(link);
  return {c.p.value_or(0.0), c.r.value_or(1.0), c.one_minus_h, c.one_minus_k};
}

std::vector<ScenarioKey> keys(const LinkField& field) {
  using Config = GilbertElliottConfig;
  auto t = field.keys_of<Config>("gilbert_elliott");
  t.optional_number("p", &Config::p, kRatio, "good to bad, per packet");
  t.optional_number("r", &Config::r, kRatio, "bad to good, per packet");
  t.number("one_minus_h", &Config::one_minus_h, kRatio,
           "loss probability in the bad state (tc's 1-h)");
  t.number("one_minus_k", &Config::one_minus_k, kRatio,
           "loss probability in the good state (tc's 1-k)");
  t.optional_number("prr", &Config::prr, {0.0, 1.0, true},
                    "instead of the four: packet reception ratio ...");
  t.optional_number("mean_burst", &Config::mean_burst, {1.0, 1e9, false},
                    "... and mean length of loss bursts, packets; >= max(1, (1-prr)/prr)");
  return t.take();
}

void check_burst(const std::string& key, double prr, double burst, const ScenarioLevel& level) {
  const double shortest = shortest_mean_burst(prr);
  if (burst >= shortest * (1.0 - kProbabilityRounding)) return;
  throw UsageError(fmt::format(
      "{0}: {1}mean_burst = {2} is too short for {1}prr = {3}: must be at least max(1, "
      "(1-prr)/prr) = {4}, because even single packets received between bursts leave a share of "
      "1/(1 + mean_burst)",
      level.source, key, burst, prr, shortest));
}

/// prr and mean_burst to p and r.
void resolve(const std::string& prefix, LinkConfig& link, const ScenarioLevel& level) {
  const GilbertElliottConfig given = of(link);
  if (!given.prr && !given.mean_burst) return;
  const std::string key = prefix + "gilbert_elliott.";
  for (const char* other : {"p", "r", "one_minus_h", "one_minus_k"}) {
    if (!level.has(key + other)) continue;
    throw UsageError(
        fmt::format("{0}: give either {1}prr and {1}mean_burst, or {1}p, r, one_minus_h and "
                    "one_minus_k",
                    level.source, key));
  }
  // One of the two alone keeps the other as it was.
  const bool simple =
      given.p && given.r && *given.r > 0.0 && given.one_minus_h == 1.0 && given.one_minus_k == 0.0;
  if (!simple && !(given.prr && given.mean_burst)) {
    throw UsageError(
        fmt::format("{0}: {1}prr and {1}mean_burst are needed together", level.source, key));
  }
  const double prr = given.prr ? *given.prr : *given.r / (*given.p + *given.r);
  const double burst = given.mean_burst ? *given.mean_burst : 1.0 / *given.r;
  check_burst(key, prr, burst, level);
  const GilbertElliott model = gilbert_from_burst(prr, burst);
  const std::string from = fmt::format("{0}prr and {0}mean_burst", key);
  level.set_derived(key + "p", std::min(1.0, model.p), from);
  level.set_derived(key + "r", std::min(1.0, model.r), from);
  auto& ge = link.own.get<GilbertElliottConfig>();
  ge.one_minus_h = 1.0;
  ge.one_minus_k = 0.0;
  ge.prr.reset();
  ge.mean_burst.reset();
}

void check(const LoadedLink& loaded) {
  if (of(loaded.link).p && of(loaded.link).r) return;
  loaded.refuse(
      "{0}model = \"gilbert_elliott\" needs {0}gilbert_elliott.p and r, or prr and mean_burst",
      loaded.prefix);
}

}  // namespace

GilbertElliott gilbert_from_burst(double prr, double mean_burst) {
  return {.p = (1.0 - prr) / (prr * mean_burst), .r = 1.0 / mean_burst};
}

double shortest_mean_burst(double prr) { return std::max(1.0, (1.0 - prr) / prr); }

GilbertElliottProcess::GilbertElliottProcess(const GilbertElliott& model, Duration delay,
                                             RandomEngine random)
    : model_(model), delay_(delay), random_(random) {}

GilbertElliottProcess::GilbertElliottProcess(const GilbertElliott& model, Duration delay,
                                             const GilbertElliottProcess& before)
    : model_(model), delay_(delay), random_(before.random_), bad_(before.bad_) {}

LinkCondition GilbertElliottProcess::on_packet(Instant) {
  const LinkCondition met = condition();
  const double luck = uniform_01(random_);
  if (luck < (bad_ ? model_.r : model_.p)) bad_ = !bad_;
  return met;
}

LinkCondition GilbertElliottProcess::condition() const {
  return {1.0 - (bad_ ? model_.one_minus_h : model_.one_minus_k), delay_};
}

ChannelExpectation expect_gilbert_elliott(const GilbertElliott& m, DelayCdf good_delay,
                                          DelayCdf bad_delay) {
  const double p_bad_to_good = m.p == 0.0 && m.r == 0.0 ? 1.0 : m.r;  // begins, and stays, good
  return ChannelExpectation::chain({{1.0 - m.p, m.p}, {p_bad_to_good, 1.0 - p_bad_to_good}},
                                   {{"good", 1.0 - m.one_minus_k, std::move(good_delay)},
                                    {"bad", 1.0 - m.one_minus_h, std::move(bad_delay)}});
}

std::string tc_gemodel(const GilbertElliott& m, double more_loss) {
  return fmt::format(" loss gemodel {} {} {} {}", tc_percent(m.p), tc_percent(m.r),
                     tc_percent(loss_of_either(m.one_minus_h, more_loss)),
                     tc_percent(loss_of_either(m.one_minus_k, more_loss)));
}

ChannelModelKind gilbert_elliott_model() {
  ChannelModelKind kind{.name = "gilbert_elliott",
                        .uses_delay_ms = true,
                        .begins_in_first = true,
                        .keys = keys,
                        .resolve = resolve,
                        .check = check};
  kind.moves = [](const LinkConfig&) { return ChannelModelKind::Moves::per_packet; };
  kind.make = [](const ProcessNeeds& needs) {
    return needs.per_packet<GilbertElliottProcess>(model_of(needs.link));
  };
  kind.expect = [](const LinkConfig& link, const ExpectedPackets& packets) {
    const DelayCdf delay = packets.delay(link.fixed.delay_ms);
    return expect_gilbert_elliott(model_of(link), delay, delay);
  };
  kind.only_delay_ms = own_delay_ms;
  kind.export_loss = [](const LinkConfig& link, const TcSender&, TcDraft& out) {
    out.command += tc_gemodel(model_of(link), out.loss);
  };
  return kind;
}

}  // namespace tether
