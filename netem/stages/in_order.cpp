#include "netem/stages/in_order.hpp"

#include <algorithm>

#include "netem/stages/kinds.hpp"
#include "netem/stages/rate.hpp"

namespace tether {
namespace {

/// Holds packets back until those before them have left.
class InOrder final : public LinkStage {
 public:
  explicit InOrder(Instant last_departure) : latest_(last_departure) {}

  Instant latest() const { return latest_; }

  bool pass(Passage& passage) override {
    passage.not_before = latest_ = std::max(passage.departure(), latest_);
    return true;
  }

 private:
  Instant latest_;
};

bool in_order(const LinkConfig& link) { return link.own.get<OrderSettings>().in_order; }

std::vector<ScenarioKey> keys(const LinkField& field) {
  auto t = field.keys_of<OrderSettings>("");
  t.boolean("in_order", &OrderSettings::in_order,
            "no packet overtakes another: it waits until those before it have left");
  return t.take();
}

StagePtr make(const StageNeeds& needs) {
  const auto* present = needs.present_as<InOrder>();
  const Instant latest = present != nullptr ? present->latest() : Instant::min();
  return std::make_unique<InOrder>(std::max(latest, needs.last_departure));
}

void export_tc(const LinkConfig& link, const TcSender&, TcDraft& out) {
  if (!out.delays_vary || link.own.get<RateSettings>().bits_per_s > 0.0) return;
  if (!in_order(link)) {
    out.notes.emplace_back(
        "packets overtake each other when delays fall, with tc as with Tether (in_order = false)");
    return;
  }
  out.command += " rate 100gbit";
  out.notes.emplace_back(
      "in_order: any rate makes netem keep the order; its queue sorts packets by their time, so a "
      "pfifo child would not");
}

}  // namespace

LinkStageKind in_order_stage() {
  LinkStageKind kind{.name = "in_order"};
  kind.on = in_order;
  kind.make = make;
  kind.keys = keys;
  kind.switch_key = "in_order";
  kind.expect = [](const LinkConfig& link, const LinkTraffic&, StageEffects& effects) {
    if (in_order(link)) effects.keeps_order = "in_order holds packets back";
  };
  kind.export_tc = export_tc;
  kind.tc_part = TcPart::order;
  return kind;
}

}  // namespace tether
