#include "can_bridge/commission/record.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <set>

#include "can_bridge/cia402/config.hpp"
#include "common/base/toml_reader.hpp"

namespace tether {
namespace {

using Item = CommissionRecord::Item;
using Result = CommissionRecord::Result;

constexpr int kFormat = 1;

std::string quoted(const std::string& text) { return toml_text(toml::value<std::string>(text)); }

void append(std::string& out, const char* section, const std::vector<Item>& items) {
  for (const Item& item : items) {
    out += fmt::format("\n[[{}]]\nname = {}\nvalue = {}\n", section, quoted(item.name),
                       quoted(item.value));
  }
}

std::string required_text(const TomlReader& reader, const char* key, const char* meaning) {
  reader.require(key, meaning);
  std::string text;
  reader.text(key, text, meaning);
  return text;
}

void each(const TomlReader& top, const char* section, const std::vector<std::string>& keys,
          const std::function<void(const TomlReader&)>& read) {
  const toml::node& node = top.require(section, fmt::format("at least one [[{}]]", section));
  const toml::array* const list = node.as_array();
  if (list == nullptr || list->empty()) {
    top.refuse(section, node, fmt::format("at least one [[{}]]", section));
  }
  for (const toml::node& entry : *list) {
    const toml::table* const table = entry.as_table();
    if (table == nullptr) top.refuse(section, entry, fmt::format("sections [[{}]]", section));
    read(TomlReader(*table, top.file(), section, keys));
  }
}

std::vector<Item> read_items(const TomlReader& top, const char* section) {
  std::vector<Item> items;
  std::set<std::string> names;
  each(top, section, {"name", "value"}, [&](const TomlReader& reader) {
    items.push_back(
        {required_text(reader, "name", "a text"), required_text(reader, "value", "a text")});
    if (!names.insert(items.back().name).second) {
      reader.refuse("name", *reader.find("name"), "a name that no other entry has");
    }
  });
  return items;
}

std::string ratio_text(const Ratio& ratio) {
  return ratio.den == 1 ? fmt::format("{}", ratio.num) : fmt::format("{}/{}", ratio.num, ratio.den);
}

void add_axis(std::vector<Item>& all, const std::string& side, const AxisConfig& axis) {
  const auto add = [&](const char* key, std::string value) {
    all.push_back({side + "." + key, std::move(value)});
  };
  add("node", std::to_string(axis.node));
  add("sign", std::to_string(axis.sign));
  add("target_velocity", to_string(axis.target_velocity));
  add("actual_velocity", to_string(axis.actual_velocity));
  add("actual_position", to_string(axis.actual_position));
  add("target_velocity_per_rps", ratio_text(axis.target_velocity_per_rps));
  add("actual_velocity_per_rps", ratio_text(axis.actual_velocity_per_rps));
  add("counts_per_revolution", ratio_text(axis.counts_per_revolution));
}

}  // namespace

bool CommissionRecord::passed() const {
  return !results.empty() && std::ranges::all_of(results, &std::string::empty, &Result::problem);
}

std::string to_toml(const CommissionRecord& record) {
  std::string out = fmt::format(
      "# Written by `tether can commission`; arming real drives requires and compares it.\n"
      "format = {}\nvehicle = {}\ninterface = {}\noperator = {}\ndate = {}\nwheels = {}\n"
      "speed_mps = {}\n",
      kFormat, quoted(record.vehicle), quoted(record.interface), quoted(record.operator_name),
      quoted(record.date), quoted(record.wheels), record.speed_mps);
  for (const Result& result : record.results) {
    out += fmt::format("\n[[result]]\ndrive = {}\ntrial = {}\nfound = {}\n", quoted(result.drive),
                       quoted(result.trial), quoted(result.found));
    if (!result.problem.empty()) out += fmt::format("problem = {}\n", quoted(result.problem));
  }
  append(out, "setting", record.settings);
  append(out, "object", record.objects);
  return out;
}

CommissionRecord parse_record(const std::string& toml, const std::string& file) {
  const toml::table table = parse_toml(toml, file);
  const TomlReader top(table, file, "",
                       {"format", "vehicle", "interface", "operator", "date", "wheels", "speed_mps",
                        "result", "setting", "object"});
  int format = 0;
  top.require("format", "1");
  top.integer("format", format, kFormat, kFormat, "format of the record");
  CommissionRecord record;
  record.vehicle = required_text(top, "vehicle", "the vehicle's name");
  record.interface = required_text(top, "interface", "a CAN interface");
  record.operator_name = required_text(top, "operator", "a name");
  record.date = required_text(top, "date", "a date");
  record.wheels = required_text(top, "wheels", "\"free\" or \"on the floor\"");
  top.require("speed_mps", "the speed of the trials");
  top.number("speed_mps", record.speed_mps, CommissionRecord::kSlowest_mps, 10.0,
             "speed of the trials, m/s");
  each(top, "result", {"drive", "trial", "found", "problem"}, [&](const TomlReader& reader) {
    Result result{required_text(reader, "drive", "a drive"),
                  required_text(reader, "trial", "a trial"),
                  required_text(reader, "found", "what was found"), ""};
    reader.text("problem", result.problem, "what is wrong");
    record.results.push_back(std::move(result));
  });
  record.settings = read_items(top, "setting");
  record.objects = read_items(top, "object");
  return record;
}

std::vector<Item> commissioned_settings(const Cia402Config& config, double wheel_radius_m) {
  std::vector<Item> all{{"vehicle.wheel_radius_m", fmt::format("{}", wheel_radius_m)},
                        {"bridge.node", std::to_string(config.master_node)},
                        {"bridge.sync", config.sync ? "true" : "false"}};
  add_axis(all, "left", config.axes[0]);
  add_axis(all, "right", config.axes[1]);
  for (const SetupWrite& write : config.setup) {
    all.push_back({fmt::format("setup of node {}, {}", write.node,
                               cia402::object_text(write.object, write.meaning)),
                   std::to_string(write.value)});
  }
  for (const WatchdogConfig& watchdog : config.watchdogs) {
    const std::string name =
        fmt::format("watchdog of node {}, {}", watchdog.node, cia402::object_text(watchdog.object));
    all.push_back({name, fmt::format("{} ms", watchdog.timeout_ms)});
    all.push_back({name + ", reaction", watchdog.reaction
                                            ? fmt::format("{} in {}", watchdog.reaction_value,
                                                          cia402::object_text(*watchdog.reaction))
                                            : "fixed"});
  }
  for (const PdoConfig& pdo : config.pdos) {
    if (pdo.transmit) continue;
    all.push_back(
        {fmt::format("{} of node {}", cia402::pdo_name(pdo), pdo.node),
         fmt::format("transmission {}, event timer {} ms", pdo.transmission, pdo.event_timer_ms)});
  }
  return all;
}

std::string differences(const std::vector<Item>& recorded, const std::vector<Item>& now) {
  std::string all;
  const auto value_in = [](const std::vector<Item>& items, const std::string& name) {
    const auto found = std::ranges::find(items, name, &Item::name);
    return found == items.end() ? std::string("not there") : found->value;
  };
  const auto add = [&](const std::string& name, const std::string& is, const std::string& was) {
    if (is != was) all += fmt::format("{}{} is {}, was {}", all.empty() ? "" : "; ", name, is, was);
  };
  for (const Item& item : now) add(item.name, item.value, value_in(recorded, item.name));
  for (const Item& item : recorded) {
    if (std::ranges::find(now, item.name, &Item::name) == now.end()) {
      add(item.name, "not there", item.value);
    }
  }
  return all;
}

}  // namespace tether
