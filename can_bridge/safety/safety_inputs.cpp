#include "can_bridge/safety/safety_inputs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tether {
namespace {

using Function = SafetyInputConfig::Function;

void append(std::string& all, const std::string& text) { all += (all.empty() ? "" : "; ") + text; }

}  // namespace

SafetyInputs::SafetyInputs(std::vector<SafetyInputConfig> inputs) {
  for (SafetyInputConfig& config : inputs) inputs_.emplace_back().config = std::move(config);
}

std::vector<CanFilter> SafetyInputs::filters() const {
  std::vector<CanFilter> filters;
  for (const Input& input : inputs_) {
    if (const auto* const can = std::get_if<SafetyInputConfig::Can>(&input.config.wiring)) {
      filters.push_back({can->id, 0x7FF});
    }
  }
  return filters;
}

bool SafetyInputs::on_frame(const CanFrame& frame, Instant now) {
  if (frame.extended || frame.remote) return false;
  bool ours = false;
  for (Input& input : inputs_) {
    const auto* const can = std::get_if<SafetyInputConfig::Can>(&input.config.wiring);
    if (can == nullptr || can->id != frame.id) continue;
    ours = true;
    input.stamp = now;
    note(input, judge(input, frame));
  }
  return ours;
}

void SafetyInputs::on_level(std::size_t i, std::optional<bool> clear) {
  const Condition heard = clear.value_or(false) ? Condition::clear : Condition::demanding;
  note(inputs_.at(i), clear ? heard : Condition::silent);
}

void SafetyInputs::note(Input& input, Condition condition) {
  input.heard = input.heard || condition != Condition::silent;
  input.level = condition;
  input.worst = std::max(input.worst, condition);
}

SafetyInputs::Condition SafetyInputs::judge(Input& input, const CanFrame& frame) {
  const auto& can = std::get<SafetyInputConfig::Can>(input.config.wiring);
  if (frame.size != can.length) {
    input.nonsense = fmt::format("has {} bytes, not {}", frame.size, can.length);
    return Condition::nonsense;
  }
  const auto bits = static_cast<std::uint8_t>(frame.data.at(can.byte) & can.mask);
  if (bits == can.clear) return Condition::clear;
  if (!can.stop || bits == *can.stop) return Condition::demanding;
  input.nonsense =
      fmt::format("says 0x{:02X}, which is neither clear (0x{:02X}) nor stop (0x{:02X})", bits,
                  can.clear, *can.stop);
  return Condition::nonsense;
}

SafetyInputs::Condition SafetyInputs::condition(const Input& input, Instant now) {
  if (const auto* const can = std::get_if<SafetyInputConfig::Can>(&input.config.wiring)) {
    const bool heard =
        input.stamp && now - *input.stamp < std::chrono::milliseconds(can->timeout_ms);
    if (!heard) return Condition::silent;
  }
  return std::max(input.level, input.worst);
}

void SafetyInputs::count(Input& input, Condition condition, Instant now) {
  if (input.before != Condition::clear) input.clear_since = now;
  if (condition == input.before) return;
  input.before = condition;
  if (condition == Condition::demanding) ++input.demands;
  if (condition == Condition::silent) ++input.silences;
  if (condition == Condition::nonsense) ++input.nonsenses;
}

SafetyDemands SafetyInputs::cycle(Instant now) {
  SafetyDemands all;
  all.ramp = all.may_resume = true;
  for (Input& input : inputs_) {
    const Condition is = condition(input, now);
    count(input, is, now);
    demand(all, input, is, now);
    input.worst = Condition::clear;
  }
  if (all.stop.empty()) all.ramp = all.may_resume = false;
  return all;
}

std::string SafetyInputs::trouble(const Input& input, Condition condition) {
  const auto* const can = std::get_if<SafetyInputConfig::Can>(&input.config.wiring);
  if (can == nullptr) {
    const auto& gpio = std::get<SafetyInputConfig::Gpio>(input.config.wiring);
    return fmt::format("safety input {}: line {} of {} cannot be read", input.config.name,
                       gpio.line, gpio.chip);
  }
  if (condition == Condition::nonsense) {
    return fmt::format("safety input {}: frame 0x{:03X} {}", input.config.name, can->id,
                       input.nonsense);
  }
  return fmt::format("safety input {}: no frame 0x{:03X} for {} ms: check its supply and plug",
                     input.config.name, can->id, can->timeout_ms);
}

void SafetyInputs::demand(SafetyDemands& all, const Input& input, Condition condition,
                          Instant now) {
  const SafetyInputConfig& config = input.config;
  const bool sound = condition == Condition::clear || condition == Condition::demanding;
  if (config.function == Function::estop_status && input.heard) {
    if (!sound) append(all.estop, trouble(input, condition));
    if (condition == Condition::demanding) {
      append(all.estop, fmt::format("safety input {}: e-stop pressed", config.name));
    }
    return;
  }
  if (!sound) {
    append(all.stop, trouble(input, condition));
    all.ramp = all.may_resume = false;
    return;
  }
  if (config.function == Function::speed_limit) {
    const double other_mps = all.speed_limit_mps.value_or(config.speed_limit_mps);
    if (condition == Condition::clear || other_mps < config.speed_limit_mps) return;
    all.speed_limit_mps = config.speed_limit_mps;
    all.speed_limit_by = "safety input " + config.name;
    return;
  }
  const Duration clear_for = condition == Condition::clear ? now - input.clear_since : Duration{0};
  const bool waits = config.restart_after_s && clear_for < from_seconds(*config.restart_after_s);
  if (condition == Condition::clear && !waits) return;
  append(all.stop,
         condition == Condition::demanding
             ? fmt::format("safety input {} demands a stop", config.name)
             : fmt::format("safety input {} has been clear for {:.1f} s, not yet for {:g} s",
                           config.name, std::floor(to_seconds(clear_for) * 10.0) / 10.0,
                           *config.restart_after_s));
  const bool resumes = config.restart_after_s.has_value();
  all.may_resume = all.may_resume && resumes;
  all.ramp = all.ramp && (resumes || config.reaction == SafetyInputConfig::Reaction::ramp);
}

void SafetyInputs::list(CounterList& out) const {
  for (const Input& input : inputs_) {
    const std::string name = "input." + input.config.name;
    out.emplace_back(name + ".demands", input.demands);
    out.emplace_back(name + ".silences", input.silences);
    out.emplace_back(name + ".nonsense", input.nonsenses);
  }
}

}  // namespace tether
