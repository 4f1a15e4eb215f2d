#include <fmt/format.h>

#include "netem/stages/coin.hpp"
#include "netem/stages/in_order.hpp"
#include "netem/stages/kinds.hpp"
#include "netem/stages/rate.hpp"

namespace tether {
namespace {

struct ReorderSettings {
  double probability = 0.0;  ///< probability that a packet skips its delay and so overtakes
  std::int64_t gap = 1;      ///< at most one packet in so many

  bool operator==(const ReorderSettings&) const = default;
};

/// Lets packets skip their delay, as tc-netem(8)'s "reorder P gap N": with the probability, but
/// only if N − 1 packets or more have been offered since the last that skipped. One draw per
/// packet.
class Reordering final : public LinkStage {
 public:
  using Settings = ReorderSettings;

  Reordering(const ReorderSettings& settings, const LinkStreams& streams)
      : gap_(settings.gap), coin_(settings.probability, streams("reorder")) {}

  void set(const ReorderSettings& settings) {
    gap_ = settings.gap;
    coin_.set(settings.probability);
  }
  void skip(std::int64_t packets) { coin_.skip(packets); }

  void meet(OfferedPacket& offered) override {
    const bool lucky = coin_.toss();
    ++since_last_;
    if (!lucky || since_last_ < gap_) return;
    since_last_ = 0;
    offered.fate.reordered = offered.goes_on();
  }

 private:
  std::int64_t gap_;
  std::int64_t since_last_ = 0;
  Coin coin_;
};

const ReorderSettings& of(const LinkConfig& link) { return link.own.get<ReorderSettings>(); }

std::vector<ScenarioKey> keys(const LinkField& field) {
  auto t = field.keys_of<ReorderSettings>("reorder");
  t.number("probability", &ReorderSettings::probability, kRatio,
           "probability that a packet skips its delay");
  t.whole_number("gap", &ReorderSettings::gap, 1,
                 "at most one packet in this many skips its delay");
  return t.take();
}

void check(const LoadedLink& loaded) {
  const double probability = of(loaded.link).probability;
  if (!loaded.link.own.get<OrderSettings>().in_order || probability <= 0.0) return;
  loaded.refuse("{0}in_order = true and {0}reorder.probability = {1} contradict each other",
                loaded.prefix, probability);
}

void expect(const LinkConfig& link, const LinkTraffic&, StageEffects& effects) {
  const auto& [probability, gap] = of(link);
  if (probability <= 0.0) return;
  effects.share_that_skips = 1.0 / (static_cast<double>(gap - 1) + 1.0 / probability);
}

void export_tc(const LinkConfig& link, const TcSender&, TcDraft& out) {
  if (of(link).probability <= 0.0) return;
  if (!out.has("delay")) {
    out.notes.emplace_back("reorder is left out: tc wants a delay that packets can skip");
    return;
  }
  out.command += " reorder " + tc_percent(of(link).probability);
  if (of(link).gap > 1) {
    out.command += fmt::format(" gap {}", of(link).gap);
    out.notes.emplace_back("reorder: netem counts the gap without the packets that it loses");
  }
  if (link.own.get<RateSettings>().bits_per_s > 0.0) {
    out.notes.emplace_back("reorder: these packets skip netem's rate limit as well");
  }
}

}  // namespace

LinkStageKind reorder_stage() {
  LinkStageKind kind{.name = "reorder"};
  kind.on = [](const LinkConfig& link) { return of(link).probability > 0.0; };
  kind.make = [](const StageNeeds& needs) { return needs.go_on<Reordering>(); };
  kind.keys = keys;
  kind.switch_key = "reorder.probability";
  kind.check = check;
  kind.expect = expect;
  kind.export_tc = export_tc;
  kind.tc_part = TcPart::reorder;
  return kind;
}

}  // namespace tether
