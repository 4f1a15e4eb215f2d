#include "tools/view/sources/network_parameters.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "common/base/errors.hpp"
#include "common/base/pattern.hpp"
#include "common/base/text.hpp"
#include "common/scenario/loader.hpp"
#include "common/scenario/section.hpp"
#include "netem/channel/change.hpp"
#include "netem/channel/settings.hpp"

namespace tether {
namespace {

const std::string kChannel = "channel.";

/// Value of text that a relay sent; none if it is no TOML, as when it was cut off.
std::optional<ScenarioValue> value_of_text(const std::string& text) {
  if (text.find('\n') != std::string::npos) return std::nullopt;
  try {
    const toml::table table = toml::parse("value = " + text);
    return to_value(*table.get("value"));
  } catch (const toml::parse_error&) {
    return std::nullopt;
  }
}

struct ToParameter {
  ParameterValue operator()(bool x) const { return x; }
  ParameterValue operator()(std::int64_t x) const { return static_cast<double>(x); }
  ParameterValue operator()(double x) const { return x; }
  ParameterValue operator()(const std::string& x) const { return x; }
  ParameterValue operator()(const NumberList& x) const { return x; }
  ParameterValue operator()(const NumberRows& x) const { return to_toml(x); }
  ParameterValue operator()(const TextList& x) const { return x; }
};

/// Description of each kind of key in key_table.cpp.
ParameterDescription described(const ScenarioKey& key) {
  ParameterDescription d;
  d.name = std::string(NetworkParameters::kPrefix) + key.name.substr(kChannel.size());
  d.allowed = key.allowed;
  d.meaning = key.meaning;
  d.can_be_set = !key.file;
  static const Pattern kNumber(R"((0 or )?a (?:finite )?(whole )?number(.*))");
  static const Pattern kInterval(R"( in [\[(]([^,]+), ([^\]]+)\])");
  static const Pattern kAtLeast(R"( >=? ([^ ]+))");
  if (const auto number = kNumber.groups(key.allowed)) {
    d.kind = number->at(1).empty() ? "number" : "whole number";
    if (const auto ends = kInterval.groups(number->at(2))) {
      d.low = to_number<double>(ends->at(0));
      d.high = to_number<double>(ends->at(1));
    } else if (const auto low = kAtLeast.groups(number->at(2))) {
      d.low = to_number<double>(low->at(0));
    }
    if (!number->at(0).empty()) d.low = 0.0;
  } else if (key.allowed == "true or false") {
    d.kind = "switch";
  } else if (key.allowed.starts_with("a list of")) {
    d.kind = "rows";
  } else if (key.allowed.starts_with("a list")) {
    d.kind = "list";
  } else if (key.allowed.starts_with('"')) {
    d.kind = "choice";
    for (std::size_t at = key.allowed.find('"'); at != std::string::npos;) {
      const std::size_t end = key.allowed.find('"', at + 1);
      d.choices.push_back(key.allowed.substr(at + 1, end - at - 1));
      at = key.allowed.find('"', end + 1);
    }
  } else {
    d.kind = "text";
  }
  return d;
}

[[noreturn]] void refuse(const ParameterDescription& key, const std::string& what) {
  throw UsageError(fmt::format("{} {}; allowed: {}", key.name, what, key.allowed));
}

std::string number_text(const ParameterDescription& key, double x) {
  if (!std::isfinite(x)) refuse(key, "is not finite");
  if (key.kind != "whole number") return fmt::format("{}", x);
  constexpr double kExact = 9e15;  // doubles hold whole numbers up to 2^53
  if (x != std::floor(x) || std::abs(x) > kExact) refuse(key, fmt::format("= {}", x));
  return fmt::format("{}", static_cast<std::int64_t>(x));
}

}  // namespace

NetworkParameters::NetworkParameters(const ChannelSettings& channel)
    : scenario_(channel_scenario(channel)) {
  scenario_.get<ChannelSettings>().changes.clear();
  describe();
}

void NetworkParameters::take(const std::vector<ChannelSetting>& settings, bool all) {
  if (all) {
    const ChannelSettings before = scenario_.get<ChannelSettings>();
    scenario_ = channel_scenario({});
    for (const auto& [name, link] : before.links) scenario_.get<ChannelSettings>().links[name];
  }
  for (const ChannelSetting& setting : settings) {
    const auto value = value_of_text(setting.value);
    if (!value) continue;
    static const Pattern kNamed(R"(links\.([A-Za-z0-9_-]{1,32})\..*)");
    constexpr std::size_t kMostLinks = 100;
    auto& links = scenario_.get<ChannelSettings>().links;
    if (const auto named = kNamed.groups(setting.key); named && links.size() < kMostLinks) {
      if (links.try_emplace(named->at(0)).second) describe();
    }
    for (const ScenarioKey& key : scenario_.schema().keys_of(scenario_)) {
      if (key.name == kChannel + setting.key) key.set(scenario_, *value);
    }
  }
}

std::vector<Parameter> NetworkParameters::values() const {
  std::vector<Parameter> values;
  std::vector<std::string> in_effect;
  for (const ScenarioKey& key : scenario_.schema().keys_of(scenario_)) {
    Parameter parameter{std::string(kPrefix) + key.name.substr(kChannel.size()), std::nullopt};
    if (const auto value = key.get(scenario_)) parameter.value = std::visit(ToParameter{}, *value);
    if (scenario_.schema().why_no_effect(scenario_, key.name).empty()) {
      in_effect.push_back(parameter.name);
    }
    values.push_back(std::move(parameter));
  }
  values.push_back({std::string(kInEffect), std::move(in_effect)});
  return values;
}

void NetworkParameters::describe() {
  descriptions_.clear();
  for (const ScenarioKey& key : scenario_.schema().keys_of(scenario_)) {
    descriptions_.push_back(described(key));
  }
  ParameterDescription in_effect;
  in_effect.name = kInEffect;
  in_effect.kind = "texts";
  in_effect.meaning = "the settings that do something now; the others wait for a model or a switch";
  in_effect.can_be_set = false;
  descriptions_.push_back(in_effect);
  places_.clear();
  for (std::size_t i = 0; i < descriptions_.size(); ++i) places_[descriptions_[i].name] = i;
}

std::vector<std::string> NetworkParameters::settings(
    const std::vector<Parameter>& parameters) const {
  if (parameters.size() > kMostAtOnce) {
    throw UsageError(fmt::format("at most {} parameters can be set at once", kMostAtOnce));
  }
  std::vector<std::string> all;
  for (const Parameter& parameter : parameters) all.push_back(setting(parameter));
  return all;
}

std::string NetworkParameters::setting(const Parameter& parameter) const {
  const auto found = places_.find(parameter.name);
  if (found == places_.end()) {
    throw UsageError(
        fmt::format("there is no parameter {}", printable(parameter.name, kLongestNameShown)));
  }
  const ParameterDescription& key = descriptions_[found->second];
  if (!key.can_be_set) refuse(key, "cannot be set from here");
  if (!parameter.value) refuse(key, "cannot be unset");
  const std::string before = key.name.substr(kPrefix.size()) + "=";
  if (const auto* x = std::get_if<bool>(&*parameter.value)) return before + (*x ? "true" : "false");
  if (const auto* x = std::get_if<double>(&*parameter.value)) return before + number_text(key, *x);
  if (const auto* x = std::get_if<std::vector<double>>(&*parameter.value)) {
    return before + to_toml(*x);
  }
  const auto* const text = std::get_if<std::string>(&*parameter.value);
  if (text == nullptr) refuse(key, "is no list of texts");
  const bool is_rows = key.kind == "rows" || key.kind == "list";
  const char* const wanted = is_rows ? "0123456789.,+-eE[] "
                                     : "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                       "0123456789_-.";
  if (text->find_first_not_of(wanted) != std::string::npos) {
    refuse(key, fmt::format("= \"{}\"", printable(*text, kLongestValueShown)));
  }
  return is_rows ? before + *text : fmt::format("{}\"{}\"", before, *text);
}

}  // namespace tether
