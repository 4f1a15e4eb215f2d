#include "can_bridge/drivetrain/config.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <fstream>
#include <optional>
#include <sstream>
#include <string_view>

#include "can_bridge/canopen/object_ref.hpp"
#include "can_bridge/drivetrain/checks.hpp"
#include "common/base/errors.hpp"
#include "common/base/toml_reader.hpp"

namespace tether {
namespace {

struct NamedObject {
  const char* name;
  ObjectRef AxisConfig::*object;
};
constexpr std::array<NamedObject, 8> kObjects{{
    {"controlword", &AxisConfig::controlword},
    {"statusword", &AxisConfig::statusword},
    {"mode", &AxisConfig::mode},
    {"mode_display", &AxisConfig::mode_display},
    {"target_velocity", &AxisConfig::target_velocity},
    {"actual_velocity", &AxisConfig::actual_velocity},
    {"actual_position", &AxisConfig::actual_position},
    {"error_code", &AxisConfig::error_code},
}};

/// Reads one file. Order matters: PDOs name the axes' objects.
class Parser {
 public:
  Parser(const toml::table& top, const std::string& file)
      : top_(top, file, "",
             {"name", "profile", "bridge", "drives", "chassis", "left", "right", "setup",
              "watchdog", "pdo", "emulation"}) {
    source_.file = file;
  }

  DrivetrainConfig parse() {
    top_.require("name", "a text in quotes (for people)");
    top_.text("name", config_.name, "for people");
    read_profile();
    if (config_.profile == DrivetrainConfig::Profile::agilex_v2) {
      refuse_sections({"bridge", "left", "right", "setup", "watchdog", "pdo", "emulation"});
      read_chassis();
      read_drives(
          {"feedback_timeout_ms", "boot_timeout_ms", "step_timeout_ms", "standstill_radps"});
      return config_;
    }
    refuse_sections({"chassis"});
    read_bridge();
    read_drives({"heartbeat_ms", "heartbeat_timeout_ms", "feedback_timeout_ms", "boot_timeout_ms",
                 "sdo_timeout_ms", "sdo_retries", "step_timeout_ms", "standstill_radps"});
    read_axis("left", 0);
    read_axis("right", 1);
    read_list("setup", &Parser::read_setup);
    read_list("watchdog", &Parser::read_watchdog);
    read_list("pdo", &Parser::read_pdo);
    read_emulation();
    check_cia402(config_, source_);
    return config_;
  }

 private:
  void read_profile() {
    const std::string allowed = "\"cia402\" or \"agilex_v2\"";
    const toml::node& node = top_.require("profile", allowed);
    const std::string profile = node.value_or(std::string{});
    if (profile == "cia402") {
      config_.profile = DrivetrainConfig::Profile::cia402;
    } else if (profile == "agilex_v2") {
      config_.profile = DrivetrainConfig::Profile::agilex_v2;
    } else {
      top_.refuse("profile", node, allowed);
    }
  }

  void refuse_sections(std::initializer_list<const char*> sections) const {
    for (const char* const section : sections) {
      if (const toml::node* const node = top_.find(section)) {
        top_.refuse_at(node->source().begin.line,
                       fmt::format("[{}] has no effect with profile = \"{}\"", section,
                                   top_.find("profile")->value_or(std::string{})));
      }
    }
  }

  const toml::table& table(const toml::node& node, const std::string& name) const {
    if (const auto* const found = node.as_table()) return *found;
    top_.refuse(name, node, fmt::format("a section [{}]", name));
  }

  void read_bridge() {
    const toml::node* const node = top_.find("bridge");
    if (node == nullptr) return;
    const TomlReader r(table(*node, "bridge"), source_.file, "bridge",
                       {"node", "heartbeat_ms", "sync"});
    source_.bridge_line = r.line();
    r.integer("node", config_.master_node, 1, 127, "CANopen node id of the bridge");
    r.integer("heartbeat_ms", config_.heartbeat_ms, 10, 1000, "period of the bridge's heartbeat");
    r.flag("sync", config_.sync, "send SYNC in every control cycle");
  }

  void read_drives(const std::vector<std::string>& keys) {
    const toml::node* const node = top_.find("drives");
    if (node == nullptr) return;
    const TomlReader r(table(*node, "drives"), source_.file, "drives", keys);
    source_.drives_line = r.line();
    DrivetrainConfig& c = config_;
    r.integer("heartbeat_ms", c.drive_heartbeat_ms, 10, 1000, "period of the drives' heartbeat");
    r.integer("heartbeat_timeout_ms", c.drive_heartbeat_timeout_ms, 30, 3000,
              "silence that means a dead drive");
    r.integer("feedback_timeout_ms", c.feedback_timeout_ms, 20, 1000,
              "age of a wheel's feedback that stops the vehicle");
    r.integer("boot_timeout_ms", c.boot_timeout_ms, 100, 60'000, "from reset to boot-up message");
    r.integer("sdo_timeout_ms", c.sdo_timeout_ms, 10, 10'000, "for the answer to one SDO request");
    r.integer("sdo_retries", c.sdo_retries, 0, 10, "of an SDO request without answer");
    r.integer("step_timeout_ms", c.step_timeout_ms, 50, 60'000,
              "for each change of a drive's state");
    r.number("standstill_radps", c.standstill_radps, 1e-4, 1.0, "wheels slower than this stand");
  }

  void read_emulation() {
    const toml::node* const node = top_.find("emulation");
    if (node == nullptr) return;
    const TomlReader r(table(*node, "emulation"), source_.file, "emulation", {"brake"});
    r.flag("brake", config_.emulated_brake,
           "a brake holds emulated wheels whose power stage is off; false: they coast");
  }

  void read_chassis() {
    const std::string allowed = "a section [chassis] with wheel_radius_m and track_m";
    const TomlReader r(table(top_.require("chassis", allowed), "chassis"), source_.file, "chassis",
                       {"wheel_radius_m", "track_m"});
    r.require("wheel_radius_m", "a number from 0.01 to 2");
    r.require("track_m", "a number from 0.05 to 10");
    r.number("wheel_radius_m", config_.chassis_wheel_radius_m, 0.01, 2.0, "of the driven wheels");
    r.number("track_m", config_.chassis_track_m, 0.05, 10.0, "between wheel centres");
  }

  void read_axis(const std::string& side, std::size_t number) {
    const TomlReader r(
        table(top_.require(side, fmt::format("a section [{}]", side)), side), source_.file, side,
        {"node", "sign", "object_offset", "controlword", "statusword", "statusword_shift", "mode",
         "mode_display", "target_velocity", "actual_velocity", "actual_position", "error_code",
         "target_velocity_per_rps", "actual_velocity_per_rps", "counts_per_revolution"});
    AxisConfig& axis = config_.axes[number];
    source_.axis_lines[number] = r.line();
    r.require("node", "a whole number from 1 to 126 (CANopen node id)");
    r.integer("node", axis.node, 1, 126, "CANopen node id");
    const toml::node& sign = r.require("sign", "1 or -1");
    axis.sign = static_cast<int>(sign.value_or(std::int64_t{0}));
    if (!sign.is_integer() || (axis.sign != 1 && axis.sign != -1)) {
      r.refuse("sign", sign, "1 or -1 (does a positive speed of the drive roll forward?)");
    }
    std::uint16_t offset = 0;
    r.integer("object_offset", offset, 0, 0x3800,
              "added to the standard's indices; 0x800 for the second axis of a node");
    for (const NamedObject& object : kObjects) {
      ObjectRef& target = axis.*object.object;
      target.index = static_cast<std::uint16_t>(target.index + offset);
      if (const toml::node* const node = r.find(object.name)) {
        target = read_object(r, object.name, *node);
      }
    }
    r.integer("statusword_shift", axis.statusword_shift, 0, 16, "bits");
    axis.target_velocity_per_rps = read_ratio(r, "target_velocity_per_rps");
    axis.actual_velocity_per_rps = read_ratio(r, "actual_velocity_per_rps");
    axis.counts_per_revolution = read_ratio(r, "counts_per_revolution");
  }

  static ObjectRef read_object(const TomlReader& r, const std::string& key,
                               const toml::node& node) {
    const auto object = parse_object(node.value_or(std::string_view{}));
    if (!object) r.refuse(key, node, kObjectForm);
    return *object;
  }

  static Ratio read_ratio(const TomlReader& r, const std::string& key) {
    const std::string allowed =
        "a whole number >= 1, or [numerator, denominator], of the drive's units";
    const toml::node& node = r.require(key, allowed);
    const auto in_range = [](std::int64_t v) { return v >= 1 && v <= 1'000'000'000; };
    Ratio ratio{0, 1};
    if (const auto* const number = node.as_integer()) ratio.num = number->get();
    const auto* const pair = node.as_array();
    if (pair != nullptr && pair->size() == 2) {
      ratio = {pair->get(0)->value_or(std::int64_t{0}), pair->get(1)->value_or(std::int64_t{0})};
    }
    const bool whole = pair == nullptr || pair->is_homogeneous(toml::node_type::integer);
    if (!whole || !in_range(ratio.num) || !in_range(ratio.den)) r.refuse(key, node, allowed);
    return ratio;
  }

  void read_list(const std::string& name, void (Parser::*read)(const toml::table&)) {
    const toml::node* const node = top_.find(name);
    if (node == nullptr) return;
    const auto* const array = node->as_array();
    if (array == nullptr) {
      top_.refuse_at(node->source().begin.line,
                     fmt::format("{0} is a list: write [[{0}]], with two brackets", name));
    }
    for (const toml::node& element : *array) (this->*read)(table(element, name));
  }

  static std::vector<std::int64_t> read_nodes(const TomlReader& r) {
    r.require("node", "a whole number from 1 to 126 (CANopen node id), or several in [ ]");
    return r.integers("node", 1, 126, "CANopen node id");
  }

  void read_setup(const toml::table& table) {
    const TomlReader r(table, source_.file, "setup",
                       {"node", "object", "value", "required", "meaning"});
    SetupWrite write;
    write.object = read_object(r, "object", r.require("object", kObjectForm));
    const auto [min, max] = object_limits(write.object);
    r.require("value", "a whole number");
    r.integer("value", write.value, min, max, "what fits " + to_string(write.object));
    r.flag("required", write.required, "false: a drive without this object is good enough");
    r.require("meaning", "a text in quotes (what the value does)");
    r.text("meaning", write.meaning, "what the value does");
    for (const std::int64_t node : read_nodes(r)) {
      write.node = static_cast<std::uint8_t>(node);
      config_.setup.push_back(write);
      source_.setup_lines.push_back(r.line());
    }
  }

  void read_watchdog(const toml::table& table) {
    const TomlReader r(table, source_.file, "watchdog",
                       {"node", "kind", "object", "timeout_ms", "reaction", "reaction_value"});
    WatchdogConfig watchdog;
    const std::string allowed = "\"heartbeat_consumer\" or \"milliseconds\"";
    const toml::node& kind = r.require("kind", allowed);
    const std::string name = kind.value_or(std::string{});
    if (name != "heartbeat_consumer" && name != "milliseconds") r.refuse("kind", kind, allowed);
    if (name == "milliseconds") {
      watchdog.kind = WatchdogConfig::Kind::milliseconds;
      r.require("object", kObjectForm);
    }
    if (const toml::node* const object = r.find("object")) {
      watchdog.object = read_object(r, "object", *object);
    }
    const char* const meaning =
        "silence of the bridge that stops the drive; 0 would be no watchdog";
    r.require("timeout_ms", fmt::format("a whole number from 30 to 1000 ({})", meaning));
    r.integer("timeout_ms", watchdog.timeout_ms, 30, 1000, meaning);
    read_reaction(r, watchdog);
    for (const std::int64_t node : read_nodes(r)) {
      watchdog.node = static_cast<std::uint8_t>(node);
      config_.watchdogs.push_back(watchdog);
      source_.watchdog_lines.push_back(r.line());
    }
  }

  static void read_reaction(const TomlReader& r, WatchdogConfig& watchdog) {
    const std::string allowed =
        "the object that says what the drive does without heartbeat, such as \"0x6007:00 i16\", "
        "with reaction_value, or \"fixed\" where the drive's manual says that it stops and has no "
        "choice";
    const bool consumer = watchdog.kind == WatchdogConfig::Kind::heartbeat_consumer;
    if (consumer) r.require("reaction", allowed);
    const toml::node* const reaction = r.find("reaction");
    const std::string text = reaction == nullptr ? "fixed" : reaction->value_or(std::string{});
    if (text == "fixed") {
      if (const toml::node* const value = r.find("reaction_value")) {
        r.refuse_at(
            value->source().begin.line,
            "watchdog.reaction_value needs watchdog.reaction = \"INDEX:SUBINDEX TYPE\", the "
            "object that it is written to");
      }
      return;
    }
    watchdog.reaction = parse_object(text);
    if (!watchdog.reaction) r.refuse("reaction", *reaction, allowed);
    const auto [min, max] = object_limits(*watchdog.reaction);
    const char* const meaning = "0x6007: 1 fault, 2 power off, 3 quick stop";
    const toml::node& value = r.require(
        "reaction_value", fmt::format("a whole number, see the drive's manual ({})", meaning));
    r.integer("reaction_value", watchdog.reaction_value, min, max,
              "what fits " + to_string(*watchdog.reaction));
    if (is_no_reaction(*watchdog.reaction, watchdog.reaction_value)) {
      r.refuse("reaction_value", value,
               fmt::format("a reaction that stops the wheels ({}); 0 is none", meaning));
    }
  }

  void read_pdo(const toml::table& table) {
    const TomlReader r(table, source_.file, "pdo",
                       {"node", "rpdo", "tpdo", "preset", "transmission", "event_timer_ms",
                        "event_timer_required", "objects"});
    if (r.has("rpdo") == r.has("tpdo")) {
      r.refuse_at(r.line(),
                  "pdo needs either rpdo = 1…4 (bridge to drive) or tpdo = 1…4 (drive to "
                  "bridge)");
    }
    PdoConfig pdo;
    pdo.transmit = r.has("tpdo");
    r.integer(pdo.transmit ? "tpdo" : "rpdo", pdo.number, 1, 4, "number of the PDO");
    r.flag("preset", pdo.preset, "true: the drive's own mapping is this one and is only checked");
    r.integer("transmission", pdo.transmission, 1, 255,
              "1 to 240: at every n-th SYNC; 254, 255: at once");
    if (pdo.transmission > 240 && pdo.transmission < 254) {
      r.refuse("transmission", *r.find("transmission"),
               "1 to 240 (at every n-th SYNC), 254 or 255 (at once)");
    }
    r.integer("event_timer_ms", pdo.event_timer_ms, 0, 60'000,
              "RPDO: deadline; TPDO: longest pause; 0: not set");
    r.flag("event_timer_required", pdo.event_timer_required,
           "true: a drive without this deadline is refused");
    const std::string allowed = "a list of objects";
    const toml::node& objects = r.require("objects", allowed);
    const auto* const list = objects.as_array();
    if (list == nullptr || list->empty()) r.refuse("objects", objects, allowed);
    for (const std::int64_t node : read_nodes(r)) {
      pdo.node = static_cast<std::uint8_t>(node);
      pdo.objects.clear();
      for (const toml::node& object : *list)
        pdo.objects.push_back(read_mapped(r, object, pdo.node));
      config_.pdos.push_back(pdo);
      source_.pdo_lines.push_back(r.line());
    }
  }

  /// "left.statusword"; "statusword" where the node has one axis only; or an object.
  ObjectRef read_mapped(const TomlReader& r, const toml::node& node, std::uint8_t can_node) const {
    const std::string text = node.value_or(std::string{});
    if (const auto object = parse_object(text)) return *object;
    const auto dot = text.find('.');
    const std::string side = dot == std::string::npos ? "" : text.substr(0, dot);
    const std::string name = dot == std::string::npos ? text : text.substr(dot + 1);
    const NamedObject* found = nullptr;
    for (const NamedObject& object : kObjects) {
      if (name == object.name) found = &object;
    }
    if (found == nullptr || (!side.empty() && side != "left" && side != "right")) {
      r.refuse("objects", node,
               "the name of an axis' object, such as \"left.controlword\", or " +
                   std::string(kObjectForm));
    }
    const bool left = config_.axes[0].node == can_node, right = config_.axes[1].node == can_node;
    if (side.empty() && left && right) {
      r.refuse(
          "objects", node,
          fmt::format("\"left.{0}\" or \"right.{0}\": both axes are on node {1}", name, can_node));
    }
    const bool wants_left = side.empty() ? left : side == "left";
    if (wants_left ? !left : !right) {
      r.refuse("objects", node, fmt::format("an object of an axis on node {}", can_node));
    }
    return config_.axes[wants_left ? 0 : 1].*(found->object);
  }

  TomlReader top_;
  DrivetrainConfig config_;
  DrivetrainSource source_;
};

}  // namespace

DrivetrainConfig parse_drivetrain(const std::string& toml, const std::string& name) {
  try {
    const toml::table top = toml::parse(toml, name);
    return Parser(top, name).parse();
  } catch (const toml::parse_error& error) {
    throw UsageError(
        fmt::format("{}:{}: {}", name, error.source().begin.line, error.description()));
  }
}

DrivetrainConfig load_drivetrain(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  if (in.peek() != std::ifstream::traits_type::eof()) text << in.rdbuf();
  if (!in.is_open() || in.bad() || !text) {
    throw UsageError(fmt::format("cannot read the drivetrain file \"{}\"", file));
  }
  return parse_drivetrain(text.str(), file);
}

}  // namespace tether
