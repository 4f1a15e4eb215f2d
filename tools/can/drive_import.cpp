#include "tools/can/drive_import.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"

namespace tether {
namespace {

constexpr std::uint16_t kSecondAxis = 0x800;
constexpr std::int64_t kBridgeNode = 0x7F;

struct AxisObject {
  const char* name;
  ObjectRef standard;
  bool in_pdo;
  bool is_written = false;
};
constexpr std::array<AxisObject, 8> kAxisObjects{{
    {"controlword", {0x6040, 0, 2, false}, true, true},
    {"statusword", {0x6041, 0, 2, false}, true},
    {"mode", {0x6060, 0, 1, true}, false, true},
    {"mode_display", {0x6061, 0, 1, true}, true},
    {"target_velocity", {0x60FF, 0, 4, true}, true, true},
    {"actual_velocity", {0x606C, 0, 4, true}, true},
    {"actual_position", {0x6064, 0, 4, true}, true},
    {"error_code", {0x603F, 0, 2, false}, true},
}};

struct Written {
  ObjectRef object;
  const char* value;  ///< "": the vehicle's, which no data sheet knows
  const char* meaning;
  const char* without;  ///< remedy if the drive does not have it; "": none
};
constexpr std::array<Written, 5> kWritten{{
    {{0x605A, 0, 2, true},
     "2",
     "quick stop: brake, then power off",
     "[drives] stop = \"setpoint\" if the drive has no quick stop"},
    {{0x605E, 0, 2, true}, "2", "own fault: brake", ""},
    {{0x6083, 0, 4, false}, "", "profile acceleration", ""},
    {{0x6084, 0, 4, false}, "", "profile deceleration", ""},
    {{0x6085, 0, 4, false},
     "",
     "quick stop deceleration",
     "the ramp of the quick stop must be set somewhere: see the manual"},
}};

class Writer {
 public:
  Writer(const EdsFile& eds, const std::vector<std::int64_t>& nodes)
      : eds_(eds), has_two_axes_(eds.find(0x6040 + kSecondAxis) != nullptr) {
    const std::int64_t first = eds.node.value_or(1);
    nodes_ = nodes.empty() ? std::vector{first, has_two_axes_ ? first : first + 1} : nodes;
    if (nodes_.size() == 1) nodes_.push_back(nodes_[0]);
    if (std::ranges::max(nodes_) >= kBridgeNode) {
      throw UsageError(
          fmt::format("{} and {} as nodes: must be below {}, which is the bridge's. Set --node "
                      "LEFT --node RIGHT",
                      nodes_[0], nodes_[1], kBridgeNode));
    }
    if (nodes_[0] == nodes_[1] && !has_two_axes_) {
      throw UsageError(fmt::format(
          "--node {}: the device has one axis (no object 0x6840), so left and right need a node "
          "each: --node LEFT --node RIGHT",
          nodes_[0]));
    }
    two_axes_ = nodes_[0] == nodes_[1];
  }

  DriveSkeleton run(const std::string& file) {
    add("# Made from {}. Lines with MISSING have to be filled in;\n"
        "# drivetrains/two_node_cia402.toml explains every key.\n\n"
        "name = {}\nprofile = \"cia402\"\n\n[bridge]\nnode = 0x7F\nheartbeat_ms = 60\nsync = "
        "true\n\n"
        "[drives]\nheartbeat_ms = 100\nheartbeat_timeout_ms = 300\nfeedback_timeout_ms = 100\n",
        printable(file, kLongestNameShown),
        in_quotes(printable(eds_.vendor + " " + eds_.product, kLongestNameShown)));
    check_heartbeat();
    check_mode();
    axis("left", nodes_[0], 0);
    axis("right", nodes_[1], two_axes_ ? kSecondAxis : 0);
    if (eds_.find(0x1029, 1) != nullptr) {
      setup({0x1029, 1, 1, false}, "0", "communication error: pre-operational", 0);
    }
    for (const std::uint16_t offset : offsets()) {
      for (const Written& written : kWritten) write(written, offset);
    }
    watchdog();
    pdos();
    return {std::move(text_), std::move(missing_)};
  }

 private:
  template <class... Args>
  void add(fmt::format_string<Args...> format, Args&&... args) {
    text_ += fmt::format(format, std::forward<Args>(args)...);
  }
  void miss(const std::string& what) {
    add("# MISSING: {}\n", what);
    missing_.push_back(what);
  }

  std::vector<std::uint16_t> offsets() const {
    if (two_axes_) return {0, kSecondAxis};
    return {0};
  }
  std::string nodes_text() const {
    return two_axes_ ? fmt::format("{}", nodes_[0]) : fmt::format("[{}, {}]", nodes_[0], nodes_[1]);
  }
  static std::string hex(std::uint16_t index) { return fmt::format("0x{:04X}", index); }
  const EdsFile::Object* object(std::uint16_t index) const {
    const auto* const found = eds_.find(index);
    return found != nullptr && found->ref.bytes > 0 ? found : nullptr;
  }

  void check_heartbeat() {
    const EdsFile::Object* const producer = object(0x1017);
    if (producer != nullptr && producer->writable) return;
    miss("a heartbeat: the device has no 0x1017 that can be written; the bridge sets it");
  }

  void check_mode() {
    const EdsFile::Object* const modes = eds_.find(0x6502);
    constexpr std::int64_t kProfileVelocity = 1 << 2;
    if (modes == nullptr || !modes->default_value) return;
    if ((*modes->default_value & kProfileVelocity) != 0) return;
    miss(fmt::format("profile velocity mode: the device's modes (0x6502) are 0x{:X}",
                     *modes->default_value));
  }

  void axis(const char* side, std::int64_t node, std::uint16_t offset) {
    add("\n[{}]\nnode = {}\n", side, node);
    if (offset != 0) add("object_offset = 0x{:X}\n", offset);
    miss(fmt::format("{}.sign = 1 or -1: does a positive speed of this drive roll forward?", side));
    for (const AxisObject& wanted : kAxisObjects) {
      const auto index = static_cast<std::uint16_t>(wanted.standard.index + offset);
      const EdsFile::Object* const found = object(index);
      if (found == nullptr) {
        miss(fmt::format("{}.{}: the device has no {}; give the object that serves", side,
                         wanted.name, hex(index)));
        continue;
      }
      ObjectRef standard = wanted.standard;
      standard.index = index;
      if (found->ref != standard) add("{} = \"{}\"\n", wanted.name, to_string(found->ref));
      if (wanted.in_pdo && !found->mappable) {
        miss(fmt::format("{}.{}: {} cannot be mapped into a PDO", side, wanted.name, hex(index)));
      }
      if (wanted.is_written && !found->writable) {
        miss(fmt::format("{}.{}: {} is read-only", side, wanted.name, hex(index)));
      }
    }
    scales(side, offset);
  }

  void scales(const char* side, std::uint16_t offset) {
    for (const std::uint16_t index :
         {0x608F, 0x6090, 0x6091, 0x6092, 0x6094, 0x6095, 0x6096, 0x60A9}) {
      for (const int sub : {0, 1, 2}) {
        const auto* const found = eds_.find(static_cast<std::uint16_t>(index + offset), sub);
        const bool is_count =
            sub == 0 && eds_.find(static_cast<std::uint16_t>(index + offset), 1) != nullptr;
        if (found == nullptr || is_count) continue;
        const auto value = found->value ? found->value : found->default_value;
        if (!value) continue;
        add("# {}:{:02X} {} is {}\n", hex(found->ref.index), sub,
            printable(found->name, kLongestNameShown), *value);
      }
    }
    miss(
        fmt::format("{}.target_velocity_per_rps: units of the target at one wheel revolution per "
                    "second, gear included",
                    side));
    miss(fmt::format("{}.actual_velocity_per_rps: the same of the reported speed", side));
    miss(fmt::format("{}.counts_per_revolution: of the wheel, gear included", side));
  }

  void write(const Written& written, std::uint16_t offset) {
    ObjectRef ref = written.object;
    ref.index = static_cast<std::uint16_t>(ref.index + offset);
    const EdsFile::Object* const found = object(ref.index);
    if (found == nullptr) {
      if (*written.without != '\0') {
        add("\n");
        miss(fmt::format("the device has no {} ({}): {}", hex(ref.index), written.meaning,
                         written.without));
      }
      return;
    }
    if (!found->writable) {
      add("\n");
      miss(fmt::format("{} ({}) is read-only: see the manual for what the device does",
                       hex(ref.index), written.meaning));
      return;
    }
    std::string value = written.value;
    if (value.empty() && found->value) value = fmt::format("{}", *found->value);
    setup(found->ref, value, written.meaning, found->default_value);
  }

  void setup(const ObjectRef& ref, const std::string& value, const char* meaning,
             std::optional<std::int64_t> default_value) {
    add("\n[[setup]]\nnode = {}\nobject = \"{}\"\nmeaning = \"{}\"\n", nodes_text(), to_string(ref),
        meaning);
    if (!value.empty()) {
      add("value = {}\n", value);
      return;
    }
    miss(fmt::format("value of {} ({}), in units of target_velocity per second{}", to_string(ref),
                     meaning,
                     default_value ? fmt::format("; the device's default is {}", *default_value)
                                   : std::string()));
  }

  void watchdog() {
    if (eds_.find(0x1016, 1) == nullptr) {
      add("\n");
      miss(
          "[[watchdog]]: the device has no heartbeat consumer (0x1016:01); give the object by "
          "which it notices that the bridge is gone");
      return;
    }
    add("\n[[watchdog]]\nnode = {}\nkind = \"heartbeat_consumer\"\ntimeout_ms = 250\n",
        nodes_text());
    const EdsFile::Object* const reaction = object(0x6007);
    if (reaction == nullptr) {
      miss(
          "watchdog.reaction: the device has no 0x6007; give the object that decides what it does "
          "when the heartbeat stays away, and reaction_value, or reaction = \"fixed\"");
      return;
    }
    add("reaction = \"{}\"\nreaction_value = 3   # quick stop; vendors renumber it: see the "
        "manual\n",
        to_string(reaction->ref));
  }

  void pdos() {
    const std::array<const char*, 2> sides{"left.", "right."};
    const std::size_t axes = offsets().size();
    for (std::size_t i = 0; i < axes; ++i) {
      const std::string of = two_axes_ ? sides.at(i) : "";
      pdo("rpdo", static_cast<int>(i + 1), {of + "controlword", of + "target_velocity"});
    }
    int number = 0;
    for (std::size_t i = 0; i < axes; ++i) {
      const std::string of = two_axes_ ? sides.at(i) : "";
      pdo("tpdo", ++number, {of + "statusword", of + "actual_velocity"});
    }
    for (std::size_t i = 0; i < axes; ++i) {
      const std::string of = two_axes_ ? sides.at(i) : "";
      std::vector<std::string> objects{of + "actual_position"};
      for (const AxisObject& more : kAxisObjects) {
        const std::string name = more.name;
        if (name != "error_code" && name != "mode_display") continue;
        const auto* const found =
            object(static_cast<std::uint16_t>(more.standard.index + offsets().at(i)));
        if (found != nullptr && found->mappable) objects.push_back(of + name);
      }
      pdo("tpdo", ++number, objects);
    }
  }

  void pdo(const std::string& kind, int number, const std::vector<std::string>& objects) {
    const bool receive = kind == "rpdo";
    const auto parameter = static_cast<std::uint16_t>((receive ? 0x1400 : 0x1800) + number - 1);
    add("\n[[pdo]]\nnode = {}\n{} = {}\ntransmission = 1\n", nodes_text(), kind, number);
    if (receive && eds_.find(parameter, 5) != nullptr) add("event_timer_ms = 100\n");
    add("objects = [\"{}\"]\n", fmt::join(objects, "\", \""));
    if (eds_.find(parameter, 1) == nullptr) {
      miss(fmt::format("{} {}: the device has no {}", kind, number, hex(parameter)));
    } else if (const auto mapping = static_cast<std::uint16_t>(parameter + 0x200);
               eds_.find(mapping, static_cast<int>(objects.size())) == nullptr) {
      miss(fmt::format("{} {}: the device maps fewer than {} objects there ({})", kind, number,
                       objects.size(), hex(mapping)));
    }
  }

  const EdsFile& eds_;
  bool has_two_axes_;
  bool two_axes_ = false;
  std::vector<std::int64_t> nodes_;
  std::string text_;
  std::vector<std::string> missing_;
};

}  // namespace

DriveSkeleton drive_skeleton(const EdsFile& eds, const std::string& file,
                             const std::vector<std::int64_t>& nodes) {
  return Writer(eds, nodes).run(file);
}

}  // namespace tether
