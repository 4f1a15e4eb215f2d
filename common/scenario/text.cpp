#include <fmt/format.h>

#include <string>
#include <variant>
#include <vector>

#include "common/scenario/channel_checks.hpp"
#include "common/scenario/keys.hpp"
#include "common/scenario/path_keys.hpp"

namespace tether {
namespace {

/// Of the ways to stop, only the chosen one's.
bool policy_ignores(const Scenario& scenario, const std::string& key) {
  using Policy = Scenario::Actuator::Policy;
  const Policy policy = scenario.actuator.policy;
  if (key == "actuator.decay_s") return policy != Policy::decay;
  const bool is_ramp =
      key == "actuator.deceleration_mps2" || key == "actuator.yaw_deceleration_radps2";
  return is_ramp && policy != Policy::ramp && policy != Policy::horizon;
}

/// False for keys of what is not chosen, and of a link's stages that are off.
bool in_effect(const Scenario& scenario, const ScenarioKey& key) {
  if (key.name.starts_with("can.")) {
    return scenario.vehicle.drivetrain == Scenario::Vehicle::Drivetrain::can;
  }
  if (!why_plant_ignores(scenario, key.name).empty()) return false;
  if (!why_path_ignores(scenario, key.name).empty()) return false;
  if (!why_law_ignores(scenario, key.name).empty()) return false;
  if (policy_ignores(scenario, key.name)) return false;
  static const Scenario kDefaults;
  bool effective = true;
  scenario.channel.for_each_link([&](const std::string& name, const LinkConfig& link) {
    const std::string prefix = "channel." + name + ".";
    if (!key.name.starts_with(prefix)) return;
    const std::string part = key.name.substr(prefix.size());
    const bool is_switch = part == "loss" || part == "in_order" || part == "jitter.law" ||
                           part.ends_with(".probability") || part == "rate.bits_per_s" ||
                           part == "slot.period_ms" || part == "queue_limit_bytes";
    effective = !(is_switch && key.get(scenario) == key.get(kDefaults)) &&
                why_no_effect(prefix, link, part).empty();
  });
  return effective;
}

/// As TOML: the shortest text that reads as the same value.
std::string to_toml(double value) {
  const std::string text = fmt::format("{}", value);
  return text.find_first_of(".e") == std::string::npos ? text + ".0" : text;
}

template <class Entry>
std::string to_toml(const std::vector<Entry>& list) {
  std::string text;
  for (const Entry& entry : list) text += (text.empty() ? "" : ", ") + to_toml(entry);
  return "[" + text + "]";
}

std::string to_toml(const std::string& text) { return fmt::format("\"{}\"", text); }
std::string to_toml(std::int64_t value) { return fmt::format("{}", value); }
std::string to_toml(bool value) { return value ? "true" : "false"; }

/// A setting of a change as a TOML string.
std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) out += c == '"' || c == '\\' ? std::string{'\\', c} : std::string{c};
  return out + "\"";
}

std::string to_toml(const Scenario::Channel::Change& change) {
  std::string list;
  for (const std::string& text : change.settings) list += (list.empty() ? "" : ", ") + quoted(text);
  return fmt::format("\n[[channel.change]]\nat_s = {}\nset = [{}]\n", to_toml(change.at_s), list);
}

}  // namespace

std::string to_toml(const ScenarioValue& value) {
  return std::visit([](const auto& v) { return to_toml(v); }, value);
}

std::string to_toml(const Scenario& scenario) {
  std::vector<ScenarioKey> keys = scenario_keys();
  for (const auto& [name, unused] : scenario.channel.links) {
    for (ScenarioKey& key : named_link_keys(name)) keys.push_back(std::move(key));
  }
  std::string text, section;
  for (const ScenarioKey& key : keys) {
    const auto value = key.get(scenario);
    if (!value || !in_effect(scenario, key)) continue;
    const auto dot = key.name.rfind('.');
    if (key.name.substr(0, dot) != section) {
      section = key.name.substr(0, dot);
      text += fmt::format("{}[{}]\n", text.empty() ? "" : "\n", section);
    }
    text += fmt::format("{} = {}\n", key.name.substr(dot + 1), to_toml(*value));
  }
  for (const Scenario::Channel::Change& change : scenario.channel.changes) text += to_toml(change);
  return text;
}

std::string describe_scenario_keys() {
  const Scenario defaults;
  std::string text;
  for (const ScenarioKey& key : scenario_keys()) {
    const auto value = key.get(defaults);
    text += fmt::format("{} = {}\n    {}; {}\n", key.name, value ? to_toml(*value) : "(not set)",
                        key.meaning, key.allowed);
  }
  text +=
      "channel.links.NAME.*\n    a link of that name, for rules of tether-netem; the keys of "
      "channel.uplink\n"
      "[[channel.change]] at_s = SECONDS, set = [\"KEY=VALUE\", ...]\n"
      "    other settings of the channel from at_s on, all at once; KEY without \"channel.\"; "
      "times ascend\n";
  return text;
}

}  // namespace tether
