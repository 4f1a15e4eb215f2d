#include "can_bridge/probe/items.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/pdo_objects.hpp"

namespace tether {
namespace {

using Kind = ProbeItem::Kind;
using Need = ProbeItem::Need;

class List {
 public:
  /// An object that is there already keeps its place and gets the stricter need.
  void add(const ProbeItem& item) {
    const auto known = std::find_if(items_.begin(), items_.end(), [&](const ProbeItem& other) {
      return same_object(other.object, item.object);
    });
    if (known == items_.end()) {
      items_.push_back(item);
      return;
    }
    known->object = item.object;
    known->name = item.name;
    known->need = std::max(known->need, item.need);
    if (item.kind != Kind::number) known->kind = item.kind;
    if (item.wanted) known->wanted = item.wanted;
    known->must_equal = known->must_equal || item.must_equal;
  }
  std::vector<ProbeItem> take() { return std::move(items_); }

 private:
  std::vector<ProbeItem> items_;
};

/// Objects of any drive. Sizes are left open, because these rows only show values and judge
/// nothing.
void add_standard(List& list) {
  const auto add = [&list](std::uint16_t index, std::uint8_t sub, const char* name, Kind kind,
                           Need need) {
    list.add({{index, sub, 0, false}, name, kind, need, {}});
  };
  add(0x1000, 0, "device type", Kind::device_type, Need::info);
  add(0x1008, 0, "device name", Kind::text, Need::info);
  add(0x1009, 0, "hardware version", Kind::text, Need::quiet);
  add(0x100A, 0, "software version", Kind::text, Need::quiet);
  add(0x1018, 1, "vendor", Kind::identity, Need::info);
  add(0x1018, 2, "product code", Kind::identity, Need::info);
  add(0x1018, 3, "revision", Kind::identity, Need::quiet);
  add(0x1018, 4, "serial number", Kind::identity, Need::quiet);
  add(0x1001, 0, "error register", Kind::error_code, Need::info);
  add(0x1003, 0, "number of past errors", Kind::number, Need::quiet);
  for (std::uint8_t i = 1; i <= 4; ++i) {
    list.add({{0x1003, i, 0, false},
              fmt::format("past error {}", i),
              Kind::error_code,
              Need::quiet,
              {}});
  }
  add(0x1017, 0, "heartbeat, every", Kind::milliseconds, Need::info);
  add(0x1016, 1, "watches heartbeat of", Kind::heartbeat_consumer, Need::info);
  add(0x1029, 1, "on communication error", Kind::number, Need::quiet);
  add(0x2000, 0, "vendor's 0x2000", Kind::number, Need::quiet);
  add(0x6502, 0, "supported modes", Kind::supported_modes, Need::info);
  add(0x6061, 0, "mode in force", Kind::number, Need::info);
  add(0x6041, 0, "statusword", Kind::statusword, Need::info);
  add(0x603F, 0, "error code", Kind::error_code, Need::info);
  add(0x6841, 0, "second axis' statusword", Kind::statusword, Need::quiet);
}

void add_axis(List& list, const AxisConfig& axis, const char* side) {
  const auto add = [&](const ObjectRef& object, const char* name, Kind kind) {
    list.add({object, fmt::format("{} {}", side, name), kind, Need::required, {}});
  };
  add(axis.controlword, "controlword", Kind::identity);
  // A statusword that is half of a longer word is not shown as a state.
  add(axis.statusword, "statusword",
      axis.statusword.bytes == 2 ? Kind::statusword : Kind::identity);
  add(axis.mode, "mode", Kind::number);
  add(axis.mode_display, "mode in force", Kind::number);
  add(axis.target_velocity, "target velocity", Kind::number);
  add(axis.actual_velocity, "actual velocity", Kind::number);
  add(axis.actual_position, "actual position", Kind::number);
  add(axis.error_code, "error code", Kind::error_code);
}

void add_pdo(List& list, const PdoConfig& pdo) {
  const cia402::PdoObjects o(pdo);
  const std::string name = cia402::pdo_name(pdo);
  list.add({o.id(), name + " identifier", Kind::cob_id, Need::required, {}});
  list.add(
      {o.transmission(), name + " transmission", Kind::number, Need::required, pdo.transmission});
  if (pdo.event_timer_ms > 0) {
    const bool required = pdo.transmit || pdo.event_timer_required;
    list.add({o.event_timer(), name + " event timer", Kind::milliseconds,
              required ? Need::required : Need::optional, pdo.event_timer_ms});
  }
  list.add({o.count(), name + " number of objects", Kind::number, Need::required,
            static_cast<std::int64_t>(pdo.objects.size()), pdo.preset});
  for (std::size_t i = 0; i < pdo.objects.size(); ++i) {
    list.add({pdo.objects[i], "mapped object", Kind::number, Need::required, {}});
    if (!pdo.preset) continue;
    list.add({o.entry(i), fmt::format("{} object {}", name, i + 1), Kind::mapping, Need::required,
              cia402::mapping_entry(pdo.objects[i]), true});
  }
}

void add_file(List& list, const Cia402Config& config, std::uint8_t node) {
  for (const PdoConfig& pdo : config.pdos) {
    if (pdo.node == node) add_pdo(list, pdo);
  }
  for (const SetupWrite& write : config.setup) {
    if (write.node != node) continue;
    list.add({write.object, write.meaning, Kind::number,
              write.required ? Need::required : Need::optional, write.value});
  }
  for (const WatchdogConfig& watchdog : config.watchdogs) {
    if (watchdog.node != node) continue;
    const bool consumer = watchdog.kind == WatchdogConfig::Kind::heartbeat_consumer;
    list.add({watchdog.object, "watchdog", consumer ? Kind::heartbeat_consumer : Kind::milliseconds,
              Need::required, config.value_of(watchdog)});
    if (watchdog.reaction) {
      list.add({*watchdog.reaction, "watchdog's reaction", Kind::number, Need::required,
                watchdog.reaction_value});
    }
  }
  list.add({{0x1017, 0, 2, false},
            "heartbeat, every",
            Kind::milliseconds,
            Need::required,
            config.drive_heartbeat_ms});
  // The axes come last, so that their names win: PDOs and setup mention the same objects.
  for (std::size_t side = 0; side < 2; ++side) {
    if (config.axes.at(side).node == node) {
      add_axis(list, config.axes.at(side), side == 0 ? "left" : "right");
    }
  }
}

std::string modes_text(std::uint32_t bits) {
  // IEC 61800-7-201, supported drive modes: bit n is mode n + 1.
  static constexpr std::array<const char*, 10> kNames{"pp", "vl", "pv",  "tq",  "",
                                                      "hm", "ip", "csp", "csv", "cst"};
  std::string text;
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    if ((bits >> i & 1U) == 0 || *kNames.at(i) == '\0') continue;
    text += (text.empty() ? "" : " ") + std::string(kNames.at(i));
  }
  const bool pv = (bits & 4U) != 0;
  return fmt::format("0x{:08X} ({}{})", bits, text, pv ? "" : "; no profile velocity!");
}

std::string printable(const std::vector<std::uint8_t>& bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) {
    if (byte == 0) break;
    text += byte >= 0x20 && byte < 0x7F ? static_cast<char>(byte) : '?';
  }
  return "\"" + text + "\"";
}

}  // namespace

std::vector<ProbeItem> scan_items() {
  return {{{0x1000, 0, 0, false}, "device type", Kind::device_type, Need::info, {}},
          {{0x1018, 1, 0, false}, "vendor", Kind::identity, Need::info, {}},
          {{0x1018, 2, 0, false}, "product code", Kind::identity, Need::info, {}}};
}

std::vector<ProbeItem> probe_items(std::uint8_t node, const Cia402Config* config) {
  List list;
  add_standard(list);
  if (config != nullptr) add_file(list, *config, node);
  return list.take();
}

std::string probe_value(const ProbeItem& item, const std::vector<std::uint8_t>& bytes) {
  if (item.kind == Kind::text || bytes.empty() || bytes.size() > 4) return printable(bytes);
  const auto size = static_cast<std::uint8_t>(bytes.size());
  const auto raw = static_cast<std::uint32_t>(canopen::read_integer(bytes.data(), size, false));
  std::string hex = fmt::format("0x{:0{}X}", raw, 2 * size);
  switch (item.kind) {
    case Kind::device_type:
      return fmt::format(
          "{} ({})", hex,
          (raw & 0xFFFF) == 402 ? "CiA 402 drive" : fmt::format("profile {}", raw & 0xFFFF));
    case Kind::statusword:
      return fmt::format("{} ({})", hex,
                         canopen::to_string(canopen::drive_state(static_cast<std::uint16_t>(raw))));
    case Kind::supported_modes:
      return modes_text(raw);
    case Kind::heartbeat_consumer:
      if ((raw & 0xFFFF) == 0 || (raw >> 16 & 0x7F) == 0) return hex + " (off)";
      return fmt::format("{} (node 0x{:02X}, {} ms)", hex, raw >> 16 & 0x7F, raw & 0xFFFF);
    case Kind::milliseconds:
      return raw == 0 ? "0 (off)" : fmt::format("{} ms", raw);
    case Kind::error_code:
      return raw == 0 ? "0 (none)" : hex;
    case Kind::cob_id:
      return fmt::format("0x{:03X}{}", raw & 0x7FF, (raw & 0x80000000U) != 0 ? " (off)" : "");
    case Kind::mapping:
      return fmt::format("0x{:04X}:{:02X}, {} bits", raw >> 16, raw >> 8 & 0xFF, raw & 0xFF);
    case Kind::identity:
    case Kind::text:
      return hex;
    case Kind::number:
      break;
  }
  return fmt::format("{}", canopen::read_integer(bytes.data(), size, item.object.is_signed));
}

}  // namespace tether
