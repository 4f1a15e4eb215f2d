#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <limits>

#include "netem/stages/kinds.hpp"

namespace tether {
namespace {

struct OutageSettings {
  /// No packet enters between t1 and t2 (t1 <= t < t2), seconds since the run's start; ascending.
  NumberRows times_s;

  bool operator==(const OutageSettings&) const = default;
};

/// Partitions of the network from t1 to t2, t1 included, t2 not.
class Outages final : public LinkStage {
 public:
  explicit Outages(const OutageSettings& settings) {
    for (const auto& outage : settings.times_s) {
      outages_.push_back({kStart + from_seconds(outage[0]), kStart + from_seconds(outage[1])});
    }
  }

  void meet(OfferedPacket& offered) override {
    if (out(offered.fate.arrival)) offered.fate.outcome = PacketFate::Outcome::outage;
  }

 private:
  struct Outage {
    Instant from;
    Instant until;
  };

  bool out(Instant now) const {
    const auto next = std::upper_bound(outages_.begin(), outages_.end(), now,
                                       [](Instant t, const Outage& o) { return t < o.from; });
    return next != outages_.begin() && now < std::prev(next)->until;
  }

  std::vector<Outage> outages_;
};

std::vector<ScenarioKey> keys(const LinkField& field) {
  auto t = field.keys_of<OutageSettings>("");
  t.rows("outages", &OutageSettings::times_s, {-1e6, 1e9, false},
         "[[t1, t2], ...]: no packet enters at t1 <= t < t2, seconds since the run's start");
  return t.take();
}

void check(const LoadedLink& loaded) {
  double free_from = -std::numeric_limits<double>::infinity();
  for (const auto& outage : loaded.link.own.get<OutageSettings>().times_s) {
    if (outage.size() != 2 || !(outage[0] < outage[1]) || outage[0] < free_from) {
      loaded.refuse("{}outages must be [[t1, t2], ...] with t1 < t2 <= the next t1", loaded.prefix);
    }
    free_from = outage[1];
  }
}

void export_tc(const LinkConfig& link, const TcSender& sender, TcDraft& out) {
  if (link.own.get<OutageSettings>().times_s.empty()) return;
  out.notes.push_back(fmt::format(
      "outages have no equivalent: netem knows no schedule; \"tc qdisc change dev {} root netem "
      "loss 100%\" begins one",
      sender.interface));
}

}  // namespace

LinkStageKind outages_stage() {
  LinkStageKind kind{.name = "outages"};
  kind.on = [](const LinkConfig& link) { return !link.own.get<OutageSettings>().times_s.empty(); };
  kind.make = [](const StageNeeds& needs) -> StagePtr {
    return std::make_unique<Outages>(needs.settings<OutageSettings>());
  };
  kind.keys = keys;
  kind.check = check;
  kind.export_tc = export_tc;
  kind.tc_part = TcPart::schedule;
  return kind;
}

}  // namespace tether
