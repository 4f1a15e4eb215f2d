#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <numbers>
#include <optional>

#include "netem/stages/delay_law.hpp"
#include "netem/stages/duplicate.hpp"
#include "netem/stages/kinds.hpp"

namespace tether {
namespace {

constexpr Range kSigned{-1e6, 1e6, false};        // ms
constexpr double kMostTcJitter_ms = 2147.483647;  // the kernel cuts J there

const JitterSettings& of(const LinkConfig& link) { return link.own.get<JitterSettings>(); }

/// Random delays, for packets and for copies.
class Jitter final : public LinkStage {
 public:
  Jitter(const DelayLaw& law, double correlation, const StageNeeds& needs)
      : packets_(law, correlation, needs.streams("delay")) {
    packets_.skip(needs.offered);
  }

  const DelayLaw& law() const { return packets_.law(); }

  void set(const DelayLaw& law, double correlation) {
    packets_.set(law, correlation);
    if (copies_) copies_->set(law, correlation);
  }

  /// While there are copies.
  void set_copies(bool on, double correlation, const StageNeeds& needs) {
    if (!on) {
      copies_.reset();
    } else if (!copies_) {
      copies_.emplace(law(), correlation, needs.streams("copy_delay"));
      copies_->skip(needs.offered);
    }
  }

  void meet(OfferedPacket&) override {
    delay_ = packets_.next();
    if (copies_) copy_delay_ = copies_->next();
  }

  bool pass(Passage& passage) override {
    passage.delay += passage.is_copy ? copy_delay_ : delay_;
    return true;
  }

 private:
  DelaySequence packets_;
  std::optional<DelaySequence> copies_;
  Duration delay_{0}, copy_delay_{0};
};

std::vector<double> table_of(const StageNeeds& needs) {
  try {
    return load_delay_table(of(needs.link));
  } catch (const UsageError& error) {
    throw UsageError(fmt::format("{}jitter.file: {}", needs.prefix, error.what()));
  }
}

StagePtr make(const StageNeeds& needs) {
  const JitterSettings& settings = of(needs.link);
  const auto* present = needs.present_as<Jitter>();
  const bool same = present != nullptr && needs.same<JitterSettings>();
  const double correlation = settings.correlation;
  const DelayLaw law = same ? present->law() : DelayLaw(settings, table_of(needs));
  auto stage = present != nullptr ? std::make_unique<Jitter>(*present)
                                  : std::make_unique<Jitter>(law, correlation, needs);
  if (!same) stage->set(law, correlation);
  stage->set_copies(needs.settings<DuplicateSettings>().probability > 0.0, correlation, needs);
  return stage;
}

std::vector<ScenarioKey> keys(const LinkField& field) {
  using Settings = JitterSettings;
  std::vector<std::string> laws;
  for (const JitterLaw& law : jitter_laws()) laws.push_back(law.name);
  auto t = field.keys_of<Settings>("jitter");
  t.one_of("law", &Settings::law, laws,
           "distribution of the delay added to the model's; the sum is never negative");
  t.number("mean_ms", &Settings::mean_ms, kSigned, "mean of the law");
  t.number("sd_ms", &Settings::sd_ms, kDelayRange_ms, "standard deviation of the law");
  t.number("shape", &Settings::shape, {2.0, 1e3, true}, "pareto, paretonormal: tail index");
  t.list("table_ms", &Settings::table_ms, kSigned,
         "table: quantiles at equally spaced probabilities from 0 to 1, or ...");
  t.file("file", &Settings::file,
         "... a file of observed delays in ms, one per line, relative to the scenario file");
  t.number("correlation", &Settings::correlation, {-0.9999, 0.9999, false},
           "correlation of successive packets' normal scores");
  return t.take();
}

std::string why_no_effect(const std::string& prefix, const LinkConfig& link,
                          const std::string& part) {
  const JitterLaw& law = jitter_law(of(link));
  if (!part.starts_with("jitter.") || part == "jitter.law" || law.uses(part.substr(7))) return "";
  return fmt::format("{}jitter.law is \"{}\"", prefix, law.name);
}

void check(const LoadedLink& loaded) {
  const JitterLaw& law = jitter_law(of(loaded.link));
  const std::string key = loaded.prefix + "jitter.";
  if (law.uses("sd_ms") && of(loaded.link).sd_ms <= 0.0) {
    loaded.refuse("{0}law = \"{1}\" needs {0}sd_ms > 0", key, law.name);
  }
  const std::string why = law.refusal != nullptr ? law.refusal(of(loaded.link)) : "";
  if (!why.empty()) loaded.refuse("{}", fmt::format(fmt::runtime(why), key));
}

/// P[x(z) <= value_s] for a standard normal z, where x never decreases.
double share_up_to(const DelayLaw& law, double value_s) {
  if (law.at_score(kMaxScore) <= value_s) return 1.0;
  if (law.at_score(-kMaxScore) > value_s) return 0.0;
  double low = -kMaxScore, high = kMaxScore;
  while (high - low > 1e-13) {
    const double middle = 0.5 * (low + high);
    if (middle == low || middle == high) break;
    (law.at_score(middle) <= value_s ? low : high) = middle;
  }
  return 0.5 * std::erfc(-low / std::numbers::sqrt2);
}

void expect(const LinkConfig& link, const LinkTraffic&, StageEffects& effects) {
  if (!of(link).on()) return;
  const auto law = std::make_shared<const DelayLaw>(of(link), load_delay_table(of(link)));
  effects.jitter = [law](double value_s) { return share_up_to(*law, value_s); };
  const double c = std::abs(of(link).correlation);
  effects.delay_vif += 2.0 * c / (1.0 - c);
}

// ----------------------------------------------------------------------------------------- tc

/// Why tc refuses the law with this mean delay; "" if it does not.
std::string refusal(const TcJitter& tc, double mean_ms) {
  if (!tc.missing.empty()) return tc.missing;
  if (tc.jitter_ms > kMostTcJitter_ms) return "netem cuts J at 2147 ms";
  if (mean_ms < 0.0) return "tc takes no negative delay";
  if (mean_ms == 0.0 && !tc.distribution.empty()) return "tc wants a delay with it";
  return "";
}

/// `delay`, the model's and the jitter.
void export_tc(const LinkConfig& link, const TcSender&, TcDraft& out) {
  const JitterSettings& jitter = of(link);
  const JitterLaw& law = jitter_law(jitter);
  const bool has_mean = law.uses("mean_ms");
  const double mean_ms = out.state_delay_ms + (has_mean ? jitter.mean_ms : 0.0);
  const TcJitter tc = law.tc != nullptr ? law.tc(jitter) : TcJitter{};
  const std::string refused = refusal(tc, mean_ms);
  const bool constant = tc.jitter_ms <= 0.0 && tc.missing.empty();
  if (constant || !refused.empty()) {
    if (!constant) {
      out.notes.push_back(fmt::format("jitter is left out, {}: {}",
                                      has_mean ? "but for its mean" : "mean included", refused));
    }
    if (mean_ms > 0.0) out.command += " delay " + tc_time(mean_ms);
    return;
  }
  out.command += fmt::format(" delay {} {}", tc_time(mean_ms), tc_time(tc.jitter_ms));
  if (!tc.distribution.empty()) out.command += " distribution " + tc.distribution;
  if (!tc.note.empty()) out.notes.push_back(tc.note);
  if (jitter.correlation != 0.0) {
    out.notes.push_back(fmt::format(
        "jitter.correlation = {:g} has no equivalent: tc's averages successive random numbers, "
        "which changes the law",
        jitter.correlation));
  }
  out.delays_vary = true;
}

}  // namespace

LinkStageKind jitter_stage() {
  LinkStageKind kind{.name = "jitter"};
  kind.on = [](const LinkConfig& link) { return of(link).on(); };
  kind.make = make;
  kind.keys = keys;
  kind.switch_key = "jitter.law";
  kind.why_no_effect = why_no_effect;
  kind.check = check;
  kind.expect = expect;
  kind.export_tc = export_tc;
  kind.tc_part = TcPart::delay;
  return kind;
}

}  // namespace tether
