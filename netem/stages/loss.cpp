#include "netem/stages/coin.hpp"
#include "netem/stages/kinds.hpp"

namespace tether {
namespace {

struct LossSettings {
  double probability = 0.0;  ///< probability of losing a packet that the channel let through

  bool operator==(const LossSettings&) const = default;
};

/// Loses packets independently of each other.
class Loss final : public LinkStage {
 public:
  using Settings = LossSettings;

  Loss(const LossSettings& settings, const LinkStreams& streams)
      : coin_(settings.probability, streams("random_loss")) {}

  void set(const LossSettings& settings) { coin_.set(settings.probability); }
  void skip(std::int64_t packets) { coin_.skip(packets); }

  void meet(OfferedPacket& offered) override {
    if (coin_.toss()) offered.lose();
  }

 private:
  Coin coin_;
};

double probability(const LinkConfig& link) { return link.own.get<LossSettings>().probability; }

std::vector<ScenarioKey> keys(const LinkField& field) {
  auto t = field.keys_of<LossSettings>("");
  t.number("loss", &LossSettings::probability, kRatio,
           "probability that a packet which the model let through is lost, independently");
  return t.take();
}

}  // namespace

LinkStageKind loss_stage() {
  LinkStageKind kind{.name = "loss"};
  kind.on = [](const LinkConfig& link) { return probability(link) > 0.0; };
  kind.make = [](const StageNeeds& needs) { return needs.go_on<Loss>(); };
  kind.keys = keys;
  kind.switch_key = "loss";
  kind.expect = [](const LinkConfig& link, const LinkTraffic&, StageEffects& effects) {
    effects.loss = loss_of_either(effects.loss, probability(link));
  };
  // The model writes the option: one netem has one loss model.
  kind.export_tc = [](const LinkConfig& link, const TcSender&, TcDraft& out) {
    out.loss = loss_of_either(out.loss, probability(link));
  };
  kind.tc_part = TcPart::loss;
  return kind;
}

}  // namespace tether
