#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/cia402/config.hpp"

namespace tether::cia402 {

/// Meaning of an object in a PDO to an axis.
enum class Signal {
  controlword,
  target_velocity,
  mode,
  statusword,
  actual_velocity,
  actual_position,
  mode_display,
  error_code,
};

/// Command of the bridge to an axis, in the drive's units.
struct Setpoint {
  std::uint16_t controlword = 0;
  std::int64_t target_velocity = 0;
};

/// The process data of a drivetrain, packed and unpacked as its file maps it. An object that both
/// axes share is unpacked for both; to pack it, both axes must want the same value.
class PdoMap {
 public:
  struct Field {
    Signal signal{};
    std::size_t axis = 0;  ///< 0 left, 1 right
    ObjectRef object;
    std::uint8_t offset = 0;  ///< bytes from the PDO's beginning
  };
  struct Pdo {
    std::uint32_t id = 0;
    std::uint8_t node = 0;
    int number = 0;
    std::uint8_t size = 0;  ///< bytes
    std::vector<Field> fields;
  };

  /// Throws UsageError if a PDO is longer than 8 bytes, an RPDO carries what no axis is commanded
  /// by, or an axis lacks controlword, target velocity, statusword, actual velocity or position.
  explicit PdoMap(const Cia402Config& config);

  /// The RPDOs, in the order of the file.
  void pack(const std::array<Setpoint, 2>& setpoints, std::vector<CanFrame>& out) const;

  /// nullptr if no TPDO has this identifier.
  const Pdo* tpdo(std::uint32_t id) const;

  /// Hands over each field's value. False, and nothing is handed over, if the frame's length is not
  /// the PDO's.
  static bool unpack(const Pdo& pdo, const CanFrame& frame,
                     const std::function<void(const Field&, std::int64_t)>& value);

  const std::vector<Pdo>& tpdos() const { return tpdos_; }
  const std::vector<Pdo>& rpdos() const { return rpdos_; }

 private:
  std::vector<Pdo> rpdos_;
  std::vector<Pdo> tpdos_;
};

}  // namespace tether::cia402
