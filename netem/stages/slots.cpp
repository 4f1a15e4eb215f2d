#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <map>

#include "netem/stages/kinds.hpp"

namespace tether {
namespace {

struct SlotSettings {
  double period_ms = 0.0;    ///< between slots in which packets are released; 0: no slots
  double jitter_ms = 0.0;    ///< each slot begins later by up to this, uniformly; <= period_ms
  std::int64_t packets = 0;  ///< released per slot at most; 0: no limit

  bool operator==(const SlotSettings&) const = default;
};

/// Times at which packets are released, as where stations take turns to send: slot k begins at
/// k·period + U_k·jitter, with independent U_k uniform in [0, 1). The slots are a function of the
/// seed and of time. With a limit, packets beyond it wait for the next slot with room, in the order
/// in which they were offered.
class Slots final : public LinkStage {
 public:
  /// One draw from `random`, now.
  Slots(const SlotSettings& settings, RandomEngine random)
      : period_(std::max(Duration{1}, from_seconds(settings.period_ms * 1e-3))),
        jitter_ns_(settings.jitter_ms * 1e6),
        limit_(settings.packets),
        seed_(random()) {}

  bool pass(Passage& passage) override {
    passage.not_before = place(passage.now, passage.departure());
    return true;
  }

 private:
  Instant begin_of(std::int64_t slot) const;
  std::int64_t first_from(Instant ready) const;
  Instant place(Instant now, Instant ready);
  void fill(std::int64_t slot);

  Duration period_;
  double jitter_ns_;
  std::int64_t limit_;
  std::uint64_t seed_;
  std::map<std::int64_t, std::int64_t> used_;  // slots with some packets: how many
  std::map<std::int64_t, std::int64_t> full_;  // runs of full slots: first, last
};

Instant Slots::begin_of(std::int64_t slot) const {
  const double luck =
      static_cast<double>(split_mix(seed_ + static_cast<std::uint64_t>(slot)) >> 11);
  return kStart + slot * period_ +
         Duration{static_cast<Duration::rep>(luck * 0x1p-53 * jitter_ns_)};
}

std::int64_t Slots::first_from(Instant ready) const {
  // With jitter up to a period, only the slot before may still begin at or after `ready`.
  const Duration since = ready - kStart;
  std::int64_t slot = since / period_;
  if (slot * period_ > since) --slot;  // division rounds towards zero
  --slot;
  while (begin_of(slot) < ready) ++slot;
  return slot;
}

/// Takes a place in the first slot with room that begins at or after `ready`; returns when it
/// begins. Slots that began before `now` are forgotten.
Instant Slots::place(Instant now, Instant ready) {
  std::int64_t slot = first_from(ready);
  if (limit_ == 0) return begin_of(slot);
  const std::int64_t past = first_from(now);
  used_.erase(used_.begin(), used_.lower_bound(past));
  while (!full_.empty() && full_.begin()->second < past) full_.erase(full_.begin());
  // Behind the run of full slots that holds this one, if any.
  const auto after = full_.upper_bound(slot);
  if (after != full_.begin() && std::prev(after)->second >= slot)
    slot = std::prev(after)->second + 1;
  if (++used_[slot] == limit_) fill(slot);
  return begin_of(slot);
}

void Slots::fill(std::int64_t slot) {
  used_.erase(slot);
  std::int64_t first = slot, last = slot;
  const auto next = full_.upper_bound(slot);
  if (next != full_.begin() && std::prev(next)->second == slot - 1) first = std::prev(next)->first;
  if (next != full_.end() && next->first == slot + 1) {
    last = next->second;
    full_.erase(next);
  }
  full_[first] = last;
}

const SlotSettings& of(const LinkConfig& link) { return link.own.get<SlotSettings>(); }

std::vector<ScenarioKey> keys(const LinkField& field) {
  auto t = field.keys_of<SlotSettings>("slot");
  t.number("period_ms", &SlotSettings::period_ms, kDelayRange_ms,
           "packets are released at multiples of this; 0 = at any time");
  t.number("jitter_ms", &SlotSettings::jitter_ms, kDelayRange_ms,
           "each slot begins later by up to this; at most the period");
  t.whole_number("packets", &SlotSettings::packets, 0,
                 "maximum number of packets released per slot; 0 = no limit");
  return t.take();
}

void check(const LoadedLink& loaded) {
  const SlotSettings& slot = of(loaded.link);
  if (slot.jitter_ms <= slot.period_ms) return;
  loaded.refuse("{0}slot.jitter_ms = {1} must not be above {0}slot.period_ms = {2}", loaded.prefix,
                slot.jitter_ms, slot.period_ms);
}

StagePtr make(const StageNeeds& needs) {
  const auto* present = needs.present_as<Slots>();
  if (present != nullptr && needs.same<SlotSettings>()) return std::make_unique<Slots>(*present);
  return std::make_unique<Slots>(of(needs.link), needs.streams("slot"));
}

void export_tc(const LinkConfig& link, const TcSender&, TcDraft& out) {
  const SlotSettings& slot = of(link);
  if (slot.period_ms <= 0.0) return;
  out.notes.push_back(fmt::format(
      "slot has no equivalent: netem's slots begin a delay after the last one was used, not on a "
      "grid of time; the nearest is \"slot {} {}{}\"",
      tc_time(slot.period_ms), tc_time(slot.period_ms + slot.jitter_ms),
      slot.packets > 0 ? fmt::format(" packets {}", slot.packets) : ""));
}

}  // namespace

LinkStageKind slots_stage() {
  LinkStageKind kind{.name = "slots"};
  kind.on = [](const LinkConfig& link) { return of(link).period_ms > 0.0; };
  kind.make = make;
  kind.keys = keys;
  kind.switch_key = "slot.period_ms";
  kind.check = check;
  kind.expect = [](const LinkConfig& link, const LinkTraffic&, StageEffects& effects) {
    if (of(link).period_ms > 0.0) effects.no_delays = "packets wait for slots";
  };
  kind.export_tc = export_tc;
  kind.tc_part = TcPart::slot;
  return kind;
}

}  // namespace tether
