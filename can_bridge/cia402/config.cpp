// Cia402Config: how it is read from its file.
#include "can_bridge/cia402/config.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <optional>
#include <string_view>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/bus/object_ref.hpp"
#include "can_bridge/cia402/checks.hpp"
#include "can_bridge/drivetrain/file.hpp"

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
class Reader {
 public:
  explicit Reader(const DrivetrainFile& file) : file_(file) { source_.file = file.name(); }

  Cia402Config run() {
    read_bridge();
    read_drives();
    read_axis("left", 0);
    read_axis("right", 1);
    file_.each("setup", {"node", "object", "value", "required", "meaning"},
               [this](const TomlReader& r) { read_setup(r); });
    file_.each("watchdog", {"node", "kind", "object", "timeout_ms", "reaction", "reaction_value"},
               [this](const TomlReader& r) { read_watchdog(r); });
    file_.each("pdo",
               {"node", "rpdo", "tpdo", "preset", "transmission", "event_timer_ms",
                "event_timer_required", "objects"},
               [this](const TomlReader& r) { read_pdo(r); });
    read_emulation();
    check_cia402(config_, source_);
    return config_;
  }

 private:
  void read_bridge() {
    const auto r = file_.section("bridge", {"node", "heartbeat_ms", "sync"});
    if (!r) return;
    r->integer("node", config_.master_node, 1, 127, "CANopen node id of the bridge");
    r->integer("heartbeat_ms", config_.heartbeat_ms, 10, 1000, "period of the bridge's heartbeat");
    r->flag("sync", config_.sync, "send SYNC in every control cycle");
  }

  void read_drives() {
    const auto r =
        file_.section("drives", {"heartbeat_ms", "heartbeat_timeout_ms", "feedback_timeout_ms",
                                 "boot_timeout_ms", "sdo_timeout_ms", "sdo_retries",
                                 "step_timeout_ms", "standstill_radps", "emcy_warnings", "stop"});
    if (!r) return;
    source_.drives_line = r->line();
    Cia402Config& c = config_;
    r->integer("heartbeat_ms", c.drive_heartbeat_ms, 10, 1000, "period of the drives' heartbeat");
    r->integer("heartbeat_timeout_ms", c.drive_heartbeat_timeout_ms, 30, 3000,
               "silence that means a dead drive");
    read_feedback_and_boot(*r, c);
    r->integer("sdo_timeout_ms", c.sdo_timeout_ms, 10, 10'000, "for the answer to one SDO request");
    r->integer("sdo_retries", c.sdo_retries, 0, 10, "of an SDO request without answer");
    read_step_and_standstill(*r, c);
    if (const toml::node* const stop = r->find("stop")) {
      const std::string text = stop->value_or(std::string{});
      if (text != "quick_stop" && text != "setpoint") {
        r->refuse("stop", *stop, "\"quick_stop\" or \"setpoint\"");
      }
      c.stops_by_setpoint = text == "setpoint";
    }
    for (const std::int64_t code :
         r->integers("emcy_warnings", 1, 0xFFFF, "codes of emergency messages that are no fault")) {
      c.emcy_warnings.push_back(static_cast<std::uint16_t>(code));
    }
  }

  void read_emulation() {
    const auto r = file_.section("emulation", {"brake", "coasting_radps2"});
    if (!r) return;
    r->flag("brake", config_.emulated_brake,
            "a brake holds emulated wheels whose power stage is off; false: they coast");
    r->number("coasting_radps2", config_.emulated_coasting_radps2, 0.01, 100.0,
              "deceleration of emulated wheels that coast, rad/s^2");
  }

  void read_axis(const std::string& side, std::size_t number) {
    const TomlReader r = file_.required_section(
        side,
        {"node", "sign", "object_offset", "controlword", "statusword", "statusword_shift", "mode",
         "mode_display", "target_velocity", "actual_velocity", "actual_position", "error_code",
         "target_velocity_per_rps", "actual_velocity_per_rps", "counts_per_revolution"},
        fmt::format("a section [{}]", side));
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

  std::vector<std::int64_t> read_nodes(const TomlReader& r) const {
    const toml::node& value =
        r.require("node", "a whole number from 1 to 126 (CANopen node id), or several in [ ]");
    const auto nodes = r.integers("node", 1, 126, "CANopen node id");
    const auto& [left, right] = config_.axes;
    // Two axes that are the same objects of a drive are the mistake then, and are reported later.
    if (left.node == right.node && left.target_velocity == right.target_velocity) return nodes;
    for (const std::int64_t node : nodes) {
      if (node == left.node || node == right.node) continue;
      r.refuse("node", value,
               fmt::format("of axes, and none has node {}: {}; change it there or here (tether can "
                           "probe --scan lists the nodes of a bus)",
                           node, nodes_text()));
    }
    return nodes;
  }

  std::string nodes_text() const {
    return fmt::format("left.node = {}, right.node = {}", config_.axes[0].node,
                       config_.axes[1].node);
  }

  void read_setup(const TomlReader& r) {
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

  void read_watchdog(const TomlReader& r) {
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

  void read_pdo(const TomlReader& r) {
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
      r.refuse("objects", node,
               fmt::format("an object of the axis on node {} ({})", can_node, nodes_text()));
    }
    return config_.axes[wants_left ? 0 : 1].*(found->object);
  }

  const DrivetrainFile& file_;
  Cia402Config config_;
  Cia402Source source_;
};

}  // namespace

Cia402Config Cia402Config::read(const DrivetrainFile& file) { return Reader(file).run(); }

std::int64_t Cia402Config::value_of(const WatchdogConfig& watchdog) const {
  const bool consumer = watchdog.kind == WatchdogConfig::Kind::heartbeat_consumer;
  return std::int64_t{consumer ? master_node : 0} << 16 | watchdog.timeout_ms;
}

bool Cia402Config::tells_mode(const AxisConfig& axis) const {
  return std::ranges::any_of(pdos, [&axis](const PdoConfig& pdo) {
    return pdo.transmit && pdo.node == axis.node &&
           std::ranges::find(pdo.objects, axis.mode_display) != pdo.objects.end();
  });
}

bool Cia402Config::is_warning(std::uint16_t emergency_code) const {
  return std::ranges::find(emcy_warnings, emergency_code) != emcy_warnings.end();
}

std::vector<std::uint8_t> Cia402Config::nodes() const {
  if (axes[0].node == axes[1].node) return {axes[0].node};
  return {axes[0].node, axes[1].node};
}

}  // namespace tether

namespace tether::cia402 {
namespace {

struct ErrorMeaning {
  std::uint32_t mask, code;
  const char* meaning;
};

// First match wins: codes before their classes.
constexpr std::array<ErrorMeaning, 24> kErrors{{
    {0xFFFF, 0x0000, "no error"},
    {0xFFFF, 0x2310, "continuous over-current: wheel blocked, or load too heavy"},
    {0xFFFF, 0x2320, "short circuit or earth leakage"},
    {0xFFFF, 0x3210, "DC link over-voltage: battery full while braking?"},
    {0xFFFF, 0x3220, "DC link under-voltage: battery, contactor, fuse"},
    {0xFFFF, 0x4210, "device too hot"},
    {0xFFFF, 0x4310, "drive too hot"},
    {0xFFFF, 0x7121, "motor blocked"},
    {0xFFFF, 0x7305, "incremental encoder fault: encoder plug"},
    {0xFFFF, 0x8110, "CAN overrun: messages lost"},
    {0xFFFF, 0x8120, "CAN error-passive: wiring, termination, bit rate"},
    {0xFFFF, 0x8130, "heartbeat of the bridge lost"},
    {0xFFFF, 0x8140, "recovered from bus-off: wiring, termination"},
    {0xFFFF, 0x8210, "PDO of wrong length"},
    {0xFFFF, 0x8250, "setpoints stopped coming"},
    {0xFFFF, 0x8611, "following error: wheel blocked, or load too heavy"},
    {0xF000, 0x2000, "current"},
    {0xF000, 0x3000, "voltage"},
    {0xF000, 0x4000, "temperature"},
    {0xF000, 0x5000, "device hardware"},
    {0xF000, 0x6000, "device software"},
    {0xF000, 0x7000, "motor, encoder or other module"},
    {0xF000, 0x8000, "monitoring"},
    {0xF000, 0x9000, "external error"},
}};

}  // namespace

std::string axis_name(const Cia402Config& config, std::size_t axis) {
  return fmt::format("{} drive (node {})", axis == 0 ? "left" : "right", config.axes[axis].node);
}

std::string node_name(const Cia402Config& config, std::uint8_t node) {
  const bool left = config.axes[0].node == node, right = config.axes[1].node == node;
  if (left != right) return axis_name(config, left ? 0 : 1);
  return fmt::format("drive (node {})", node);
}

std::string pdo_name(const PdoConfig& pdo) {
  return fmt::format("{}PDO{}", pdo.transmit ? "T" : "R", pdo.number);
}

std::string object_text(const ObjectRef& object, const std::string& meaning) {
  const std::string name = fmt::format("0x{:04X}:{:X}", object.index, object.sub);
  return meaning.empty() ? name : fmt::format("{} ({})", name, meaning);
}

std::string error_text(std::uint32_t code) {
  for (const ErrorMeaning& e : kErrors) {
    if ((code & e.mask) == e.code) return fmt::format("0x{:04X} ({})", code, e.meaning);
  }
  return fmt::format("0x{:04X} (vendor's own, see the drive's manual)", code);
}

}  // namespace tether::cia402

namespace tether {

TransmitRules Cia402Config::transmit_rules() const {
  TransmitRules rules;
  rules.frames = {{canopen::kNmt}, {canopen::kSync}, {canopen::kHeartbeat + master_node}};
  for (const AxisConfig& axis : axes) {
    rules.setpoints.push_back(axis.target_velocity);
    rules.controlwords.push_back(axis.controlword);
    rules.sdo_ids.push_back(canopen::kSdoRequest + axis.node);
    rules.frames.push_back({canopen::kSdoRequest + axis.node});
  }
  rules.stop_words = {canopen::kControlQuickStop, canopen::kControlDisableVoltage};
  for (const PdoConfig& pdo : pdos) {
    if (pdo.transmit) continue;
    assert(pdo.number >= 1 && pdo.number <= 4);
    TransmitRules::Frame frame{canopen::pdo_id(false, pdo.number, pdo.node)};
    unsigned offset = 0;
    for (const ObjectRef& object : pdo.objects) {
      const bool setpoint = std::any_of(rules.setpoints.begin(), rules.setpoints.end(),
                                        [&](const ObjectRef& s) { return same_object(s, object); });
      const unsigned bytes = ((1U << object.bytes) - 1U) << offset;
      if (setpoint) frame.setpoint_mask = static_cast<std::uint8_t>(frame.setpoint_mask | bytes);
      offset += object.bytes;
    }
    rules.frames.push_back(frame);
  }
  return rules;
}

}  // namespace tether
