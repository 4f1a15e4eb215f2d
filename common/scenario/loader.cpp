#include "common/scenario/loader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <memory>
#include <numeric>
#include <optional>
#include <sstream>
#include <string_view>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/path/check.hpp"
#include "common/path/planned_path.hpp"
#include "common/scenario/channel_checks.hpp"
#include "common/scenario/channel_settings.hpp"
#include "common/scenario/checks.hpp"
#include "common/scenario/keys.hpp"
#include "common/scenario/path_keys.hpp"

namespace tether {
namespace {

std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replace = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({replace, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row.back();
}

std::string last_part(const std::string& key) { return key.substr(key.rfind('.') + 1); }

constexpr char kLinks[] = "channel.links.";

/// "sat" for "channel.links.sat.prr" and "channel.links.sat"; empty for keys of something else.
std::string link_name(const std::string& key) {
  if (!key.starts_with(kLinks)) return "";
  const auto begin = std::string(kLinks).size();
  return key.substr(begin, key.find('.', begin) - begin);
}

/// The keys among which this one is to be looked up.
const std::vector<ScenarioKey>& keys_beside(const std::string& key) {
  const std::string name = link_name(key);
  if (name.empty()) return scenario_keys();
  static thread_local std::map<std::string, std::vector<ScenarioKey>> known;
  const auto found = known.find(name);
  return found != known.end() ? found->second : known[name] = named_link_keys(name);
}

const ScenarioKey* find_key(const std::string& name) {
  const auto& keys = keys_beside(name);
  const auto found = std::find_if(keys.begin(), keys.end(),
                                  [&name](const ScenarioKey& k) { return k.name == name; });
  return found == keys.end() ? nullptr : &*found;
}

/// What may be given in place of `key`: also keys of both links at once, "channel.prr".
std::vector<std::string> names_beside(const std::string& key) {
  const std::string uplink = "channel.uplink.";
  std::vector<std::string> names;
  for (const ScenarioKey& k : keys_beside(key)) names.push_back(k.name);
  for (std::size_t i = 0, all = names.size(); i < all; ++i) {
    if (names[i].starts_with(uplink)) names.push_back("channel." + names[i].substr(uplink.size()));
  }
  return names;
}

[[noreturn]] void refuse_unknown(const std::string& place, const std::string& key) {
  const std::vector<std::string> names = names_beside(key);
  const auto nearest =
      std::min_element(names.begin(), names.end(), [&key](const auto& a, const auto& b) {
        return edit_distance(a, key) < edit_distance(b, key);
      });
  const auto same_name = std::find_if(names.begin(), names.end(), [&key](const auto& name) {
    return last_part(name) == last_part(key);
  });
  const auto& hint =
      edit_distance(*nearest, key) > 3 && same_name != names.end() ? same_name : nearest;
  throw UsageError(fmt::format(
      "{}: unknown key \"{}\" (did you mean \"{}\"? `tether run --keys` lists all keys)", place,
      key, *hint));
}

std::optional<NumberList> to_numbers(const toml::array& array) {
  NumberList numbers;
  for (const toml::node& entry : array) {
    const auto number = entry.value<double>();
    if (!number || !entry.is_number()) return std::nullopt;
    numbers.push_back(*number);
  }
  return numbers;
}

std::optional<ScenarioValue> to_lists(const toml::array& array) {
  if (const auto numbers = to_numbers(array)) return *numbers;
  NumberRows rows;
  for (const toml::node& entry : array) {
    const auto* row = entry.as_array();
    const auto numbers = row == nullptr ? std::nullopt : to_numbers(*row);
    if (!numbers) return std::nullopt;
    rows.push_back(*numbers);
  }
  return rows;
}

std::optional<ScenarioValue> to_value(const toml::node& node) {
  if (const auto* v = node.as_boolean()) return v->get();
  if (const auto* v = node.as_integer()) return v->get();
  if (const auto* v = node.as_floating_point()) return v->get();
  if (const auto* v = node.as_string()) return v->get();
  if (const auto* v = node.as_array()) return to_lists(*v);
  return std::nullopt;
}

toml::table parse_value(const std::string& value, const std::string& place) {
  try {
    if (value.find('\n') == std::string::npos) return toml::parse("value = " + value);
    throw UsageError(fmt::format("{}: the value must be one line", place));
  } catch (const toml::parse_error&) {
    // Numbers may be written as elsewhere than in TOML: .49 for 0.49.
    double number = 0.0;
    const auto [end, failed] = std::from_chars(value.data(), value.data() + value.size(), number);
    if (failed == std::errc{} && end == value.data() + value.size()) {
      return toml::table{{"value", number}};
    }
    // Quotes around strings may be left out: --set controller.law=pid.
    if (value.empty() || value.find_first_of("\"'\n[]{}") != std::string::npos) {
      throw UsageError(fmt::format("{}: cannot read the value", place));
    }
    return toml::table{{"value", value}};
  }
}

std::unique_ptr<const PlannedPath> plan(const Scenario::Path& config, const std::string& file) {
  try {
    return plan_path(config);
  } catch (const UsageError& error) {
    // What is wrong with a file of waypoints is said with its name.
    const bool has_name =
        !config.csv.empty() && std::string_view(error.what()).starts_with(config.csv);
    throw UsageError(has_name ? error.what() : fmt::format("{}: {}", file, error.what()));
  }
}

/// Puts the vehicle where its path begins, but for what `given` says.
void start_at(const PathPoint& start, const std::set<std::string>& given, VehicleConfig& vehicle) {
  if (!given.contains("vehicle.start_x_m")) vehicle.start_x_m = start.x_m;
  if (!given.contains("vehicle.start_y_m")) vehicle.start_y_m = start.y_m;
  if (!given.contains("vehicle.start_yaw_rad")) vehicle.start_yaw_rad = start.yaw_rad;
}

constexpr const char* kChanges = "channel.change";
constexpr double kLatestChange_s = 1e6;

/// One table of channel.change; nullopt if anything in it is not as it must be.
std::optional<Scenario::Channel::Change> to_change(const toml::node& node) {
  const auto* table = node.as_table();
  const auto* list = table == nullptr ? nullptr : (*table)["set"].as_array();
  if (list == nullptr || list->empty() || table->size() != 2) return std::nullopt;
  const toml::node* at = table->get("at_s");
  if (at == nullptr || !at->is_number()) return std::nullopt;
  Scenario::Channel::Change change{*at->value<double>(), {}};
  if (!(std::abs(change.at_s) <= kLatestChange_s)) return std::nullopt;
  for (const toml::node& entry : *list) {
    const auto* text = entry.as_string();
    if (text == nullptr) return std::nullopt;
    change.settings.push_back(text->get());
  }
  return change;
}

}  // namespace

std::vector<std::string> keys_meant_by(const std::string& key) {
  const std::string prefix = "channel.";
  const std::string rest = key.starts_with(prefix) ? key.substr(prefix.size()) : "";
  if (rest.empty() || rest == "shared_state" || rest.starts_with("uplink.") ||
      rest.starts_with("downlink.") || rest.starts_with("links.")) {
    return {key};
  }
  return {prefix + "uplink." + rest, prefix + "downlink." + rest};
}

void ScenarioLoader::apply_table(const toml::table& table, const std::string& prefix,
                                 const std::string& file) {
  for (const auto& [name, node] : table) {
    const std::string key = prefix + std::string(name.str());
    const std::string place = fmt::format("{}:{}", file, node.source().begin.line);
    if (const auto* inner = node.as_table()) {
      const auto& keys = keys_beside(key);
      // A misspelt section with keys is refused at its first key.
      if (inner->empty() && key + "." != kLinks &&
          std::none_of(keys.begin(), keys.end(),
                       [&key](const ScenarioKey& k) { return k.name.starts_with(key + "."); })) {
        refuse_unknown(place, key);
      }
      make_link(key, place);
      apply_table(*inner, key + ".", file);
    } else {
      key == kChanges ? read_changes(node, place) : apply(key, node, place);
    }
  }
}

void ScenarioLoader::apply_override(const std::string& text, const std::string& place) {
  const auto equals = text.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw UsageError(fmt::format("{}: expected KEY=VALUE", place));
  }
  const std::string key = std::string(trimmed(text.substr(0, equals)));
  const toml::table parsed = parse_value(std::string(trimmed(text.substr(equals + 1))), place);
  if (key == kChanges) return read_changes(*parsed.get("value"), place);
  for (const std::string& target : keys_meant_by(key)) {
    if (find_key(target) == nullptr) refuse_unknown(place, key);
    apply(target, *parsed.get("value"), place);
  }
}

void ScenarioLoader::end_level(const std::string& source, const std::filesystem::path& folder) {
  if (given_.contains("can.drivetrain")) {
    auto& file = scenario_.can.drivetrain_file;
    file = (folder / file).lexically_normal().string();
  }
  if (given_.contains("path.csv")) {
    scenario_.path.csv = (folder / scenario_.path.csv).lexically_normal().string();
  }
  for (const std::string& key : given_) {
    if (key.starts_with("vehicle.start_")) start_given_.insert(key);
  }
  if (given_.contains("controller.tau_table") && !scenario_.controller.tau_table.empty()) {
    auto& file = scenario_.controller.tau_table;
    file = (folder / file).lexically_normal().string();
  }
  check_plant_and_path(source);
  const ChannelLevel level{
      source, folder, [this](const std::string& key) { return given_.contains(key); },
      [this, &source](const std::string& key, double value, const std::string& from) {
        set_derived(key, value, from, source);
      }};
  scenario_.channel.for_each_link([&](const std::string& name, LinkConfig& link) {
    const std::string prefix = "channel." + name + ".";
    check_effect(prefix, link, source);
    resolve_link(prefix, link, level);
  });
  if (given_.contains(kChanges)) {
    for (Scenario::Channel::Change& change : scenario_.channel.changes) {
      for (std::string& setting : change.settings) setting = setting_in_folder(setting, folder);
    }
  }
  given_.clear();
}

Scenario ScenarioLoader::finish(const std::string& file) const {
  Scenario scenario = scenario_;
  std::unique_ptr<const PlannedPath> path;
  if (!is_whole_) path = plan(scenario.path, file);
  if (path) start_at(path->at(0.0), start_given_, scenario.vehicle);
  check_combinations(scenario, file);
  if (path) check_path(*path, scenario, file);
  return scenario;
}

/// The link that a key or a table is of, if it is of one by name.
void ScenarioLoader::make_link(const std::string& key, const std::string& place) {
  const std::string name = link_name(key);
  if (!key.starts_with(kLinks)) return;
  const std::string why = why_no_link_name(name, scenario_.channel);
  if (!why.empty()) {
    throw UsageError(fmt::format("{}: link name \"{}\" is not allowed: {}", place, name, why));
  }
  scenario_.channel.links.try_emplace(name);
}

void ScenarioLoader::apply(const std::string& key, const toml::node& node,
                           const std::string& place) {
  const ScenarioKey* found = find_key(key);
  if (found == nullptr) refuse_unknown(place, key);
  make_link(key, place);
  const auto value = to_value(node);
  if (!value || !found->set(scenario_, *value)) {
    std::ostringstream shown;
    shown << toml::node_view<const toml::node>(&node);
    throw UsageError(fmt::format("{}: {} = {} is not allowed: must be {} ({})", place, key,
                                 shown.str(), found->allowed, found->meaning));
  }
  given_.insert(key);
}

void ScenarioLoader::read_changes(const toml::node& node, const std::string& place) {
  const auto* list = node.as_array();
  std::vector<Scenario::Channel::Change> changes;
  for (std::size_t i = 0; list != nullptr && i < list->size(); ++i) {
    if (const auto change = to_change((*list)[i])) changes.push_back(*change);
  }
  if (list == nullptr || changes.size() != list->size()) {
    throw UsageError(
        fmt::format("{0}: each [[{1}]] must have at_s, a number in [-{2}, {2}], and set, a list of "
                    "one \"KEY=VALUE\" or more, and nothing else",
                    place, kChanges, kLatestChange_s));
  }
  scenario_.channel.changes = std::move(changes);
  given_.insert(kChanges);
}

/// Sets what follows from other keys, within the same limits as if it had been given.
void ScenarioLoader::set_derived(const std::string& key, double value, const std::string& from,
                                 const std::string& file) {
  const ScenarioKey* found = find_key(key);
  if (!found->set(scenario_, value)) {
    throw UsageError(fmt::format("{}: {} give {} = {}, which is not allowed: must be {}", file,
                                 from, key, value, found->allowed));
  }
}

/// A setting that the link's model ignores is a mistake, not a wish: one forgotten line would
/// turn a bad network into a perfect one.
void ScenarioLoader::check_effect(const std::string& prefix, const LinkConfig& link,
                                  const std::string& source) const {
  for (const std::string& key : given_) {
    if (!key.starts_with(prefix)) continue;
    const std::string why = why_no_effect(prefix, link, key.substr(prefix.size()));
    if (why.empty()) continue;
    throw UsageError(fmt::format("{}: {} has no effect: {}", source, key, why));
  }
}

/// The same for masses and friction where nothing has any, and for other paths' sizes.
void ScenarioLoader::check_plant_and_path(const std::string& source) const {
  for (const std::string& key : given_) {
    std::string why = why_plant_ignores(scenario_, key);
    if (why.empty()) why = why_path_ignores(scenario_, key);
    if (why.empty()) continue;
    throw UsageError(fmt::format("{}: {} has no effect: {}", source, key, why));
  }
}

}  // namespace tether
