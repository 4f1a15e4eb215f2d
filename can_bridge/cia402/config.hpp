#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/bus/object_ref.hpp"
#include "can_bridge/drivetrain/config.hpp"
#include "can_bridge/drivetrain/transmit_rules.hpp"

namespace tether {

class DrivetrainFile;

/// An exact scale factor: integers, so that nothing drifts.
struct Ratio {
  std::int64_t num = 1;
  std::int64_t den = 1;

  double value() const { return static_cast<double>(num) / static_cast<double>(den); }
};

/// One wheel's axis of a CiA 402 drive. Objects are the standard's unless the file says otherwise;
/// axes of one node may share objects (a common controlword, or a statusword with both halves).
struct AxisConfig {
  std::uint8_t node = 1;  ///< CANopen node id, 1…126
  int sign = 1;           ///< +1 or −1: a positive speed of the drive rolls forward or backward
  ObjectRef controlword{0x6040, 0, 2, false};
  ObjectRef statusword{0x6041, 0, 2, false};
  int statusword_shift = 0;  ///< bits; 16 where the upper half of a 32-bit word is this axis's
  ObjectRef mode{0x6060, 0, 1, true};  ///< modes of operation; 3 is profile velocity
  ObjectRef mode_display{0x6061, 0, 1, true};
  ObjectRef target_velocity{0x60FF, 0, 4, true};
  ObjectRef actual_velocity{0x606C, 0, 4, true};
  ObjectRef actual_position{0x6064, 0, 4, true};
  ObjectRef error_code{0x603F, 0, 2, false};
  Ratio target_velocity_per_rps{60, 1};  ///< units of target_velocity per wheel revolution/second
  Ratio actual_velocity_per_rps{60, 1};  ///< units of actual_velocity per wheel revolution/second
  Ratio counts_per_revolution{4096, 1};  ///< units of actual_position per wheel revolution
};

/// An object that start-up writes and reads back.
struct SetupWrite {
  std::uint8_t node = 1;
  ObjectRef object;
  std::int64_t value = 0;
  /// Where the drive has no such object or refuses the value: true = refuse to arm, false = go on.
  bool required = true;
  std::string meaning;  ///< "quick stop ramp, then power off": appears in reasons
};

/// A drive-side watchdog: what stops the wheels when the bridge or the cable dies. Each node needs
/// at least one that was set and read back non-zero. A heartbeat consumer by itself only notices:
/// files have to say what the drive does then.
struct WatchdogConfig {
  enum class Kind {
    heartbeat_consumer,  ///< CiA 301 0x1016: value is (master node << 16) | milliseconds
    milliseconds,        ///< a vendor's object that takes milliseconds
  };
  std::uint8_t node = 1;
  Kind kind = Kind::heartbeat_consumer;
  ObjectRef object{0x1016, 1, 4, false};
  std::uint16_t timeout_ms = 250;
  /// Reaction of the drive when it misses the bridge: start-up writes `reaction_value` to this
  /// object and reads it back, and a drive that refuses is not armed. nullopt: the drive has no
  /// choice.
  std::optional<ObjectRef> reaction{};
  std::int64_t reaction_value = 0;
};

/// A process data object. Its mapping is written at start-up (switch off, clear, map, count,
/// switch on), unless `preset`: then the drive's own mapping is this one already and is only read
/// back.
struct PdoConfig {
  std::uint8_t node = 1;
  int number = 1;         ///< 1…4
  bool transmit = false;  ///< false: RPDO, bridge → drive; true: TPDO, drive → bridge
  bool preset = false;
  std::uint8_t transmission = 255;  ///< 1…240: at every n-th SYNC; 254/255: event-driven
  /// RPDO: the drive faults when none came for this long (0x1400:5). TPDO: sent at least this often
  /// (0x1800:5). 0: not written.
  std::uint16_t event_timer_ms = 0;
  /// RPDO: whether a drive that has no 0x1400:5 is refused.
  bool event_timer_required = false;
  std::vector<ObjectRef> objects;  ///< at most 8 bytes in all
};

/// A drivetrain of CiA 402 drives, as described in a file of drivetrains/
/// (docs/howto/drivetrain.md). The functions are its row in profiles/profiles.hpp.
struct Cia402Config : DrivetrainCommon {
  static constexpr const char* kProfile = "cia402";
  static constexpr std::array kSections{"bridge", "drives",   "left", "right",
                                        "setup",  "watchdog", "pdo",  "emulation"};

  std::uint8_t master_node = 0x7F;  ///< node id of the bridge's own heartbeat
  std::uint16_t heartbeat_ms =
      60;            ///< period of the bridge's heartbeat; rounded up to control cycles
  bool sync = true;  ///< send SYNC every control cycle
  std::uint16_t drive_heartbeat_ms = 100;  ///< period of the drives' heartbeat (0x1017)
  std::uint16_t drive_heartbeat_timeout_ms = 300;
  std::uint16_t sdo_timeout_ms = 500;
  int sdo_retries = 2;
  /// Wheels stop by a target of zero and the profile deceleration (0x6084), because the drive has
  /// no quick stop ramp: no 0x605A and 0x6085 are demanded of the file.
  bool stops_by_setpoint = false;
  /// Codes of emergency messages that are counted and told, and are no fault.
  std::vector<std::uint16_t> emcy_warnings;
  std::array<AxisConfig, 2> axes;  ///< left, right
  std::vector<SetupWrite> setup;   ///< in this order
  std::vector<WatchdogConfig> watchdogs;
  std::vector<PdoConfig> pdos;
  /// For the emulated drives: a brake holds wheels whose power stage is off; else they coast.
  bool emulated_brake = true;
  double emulated_coasting_radps2 = 1.0;  ///< how such wheels slow down

  /// Refuses also what cannot work: a PDO of more than 8 bytes, an axis whose setpoint or
  /// statusword no PDO carries, a node without watchdog…
  static Cia402Config read(const DrivetrainFile& file);
  /// NMT (0x000), SYNC (0x080), the bridge's heartbeat (0x700 + master), SDO requests (0x600 +
  /// node) and the configured RPDOs. Setpoints are the axes' target_velocity objects in RPDOs and
  /// SDO downloads. By SDO, controlwords are "quick stop" or "disable voltage".
  TransmitRules transmit_rules() const;
  /// Refuses a control cycle (can.cycle_ms) so slow that the drives' and the bridge's own time-outs
  /// would trip when one frame is lost: each has to outlast three of what it waits for. Throws
  /// UsageError.
  void check_cycle(double cycle_ms) const;
  /// Refuses quick stop ramps below `mps2` (can.max_deceleration_mps2) at the wheel's rim. Throws
  /// UsageError.
  void check_deceleration(double mps2, double wheel_radius_m) const;
  /// The weaker axis' quick stop ramp, and the later axis' deadline: that of its setpoints
  /// (0x1400:5) if it is required, else its node's watchdog.
  OwnStop own_stop(double wheel_radius_m) const;
  /// Value of `watchdog.object`.
  std::int64_t value_of(const WatchdogConfig& watchdog) const;
  /// Whether a TPDO carries the mode of operation that `axis` displays.
  bool tells_mode(const AxisConfig& axis) const;
  bool is_warning(std::uint16_t emergency_code) const;
  /// The drives' node ids, each once.
  std::vector<std::uint8_t> nodes() const;
};

}  // namespace tether

/// How CiA 402 drives, objects and errors are called in texts for technicians.
namespace tether::cia402 {

/// "left drive (node 1)", "right drive (node 2)".
std::string axis_name(const Cia402Config& config, std::size_t axis);

/// Same as axis_name() where the node has one axis, else "drive (node 1)".
std::string node_name(const Cia402Config& config, std::uint8_t node);

/// "TPDO1".
std::string pdo_name(const PdoConfig& pdo);

/// "0x1016:1 (heartbeat consumer)"; without meaning: "0x1016:1".
std::string object_text(const ObjectRef& object, const std::string& meaning = "");

/// "0x8130 (heartbeat of the bridge lost)": error codes of EMCY and 0x603F (CiA 301, table 26;
/// IEC 61800-7-201, error codes).
std::string error_text(std::uint32_t code);

}  // namespace tether::cia402
