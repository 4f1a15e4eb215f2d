#include "netem/stages/duplicate.hpp"

#include "netem/stages/coin.hpp"
#include "netem/stages/kinds.hpp"

namespace tether {
namespace {

class Duplication final : public LinkStage {
 public:
  using Settings = DuplicateSettings;

  Duplication(const DuplicateSettings& settings, const LinkStreams& streams)
      : coin_(settings.probability, streams("duplicate")) {}

  void set(const DuplicateSettings& settings) { coin_.set(settings.probability); }
  void skip(std::int64_t packets) { coin_.skip(packets); }

  void meet(OfferedPacket& offered) override {
    if (coin_.toss()) offered.copied = true;
  }

 private:
  Coin coin_;
};

double probability(const LinkConfig& link) { return link.own.get<DuplicateSettings>().probability; }

std::vector<ScenarioKey> keys(const LinkField& field) {
  auto t = field.keys_of<DuplicateSettings>("duplicate");
  t.number("probability", &DuplicateSettings::probability, kRatio,
           "probability that a packet is sent twice");
  return t.take();
}

void export_tc(const LinkConfig& link, const TcSender&, TcDraft& out) {
  if (probability(link) <= 0.0) return;
  const bool lossy = out.has("loss");
  out.command += " duplicate " + tc_percent(probability(link));
  if (!lossy) return;
  out.notes.emplace_back(
      "duplicate: netem tosses for the copy before the loss, so that one of the two may survive "
      "where Tether loses the packet, and for the loss of a copy again");
}

}  // namespace

LinkStageKind duplicate_stage() {
  LinkStageKind kind{.name = "duplicate"};
  kind.on = [](const LinkConfig& link) { return probability(link) > 0.0; };
  kind.make = [](const StageNeeds& needs) { return needs.go_on<Duplication>(); };
  kind.keys = keys;
  kind.switch_key = "duplicate.probability";
  kind.export_tc = export_tc;
  kind.tc_part = TcPart::duplicate;
  return kind;
}

}  // namespace tether
