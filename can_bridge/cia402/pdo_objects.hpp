#pragma once

#include <cstddef>
#include <cstdint>

#include "can_bridge/cia402/config.hpp"

namespace tether::cia402 {

/// The objects that describe a PDO to its drive (CiA 301, 7.5.2.35 to 7.5.2.38): 0x1400…, 0x1600…
/// of an RPDO, 0x1800…, 0x1A00… of a TPDO.
class PdoObjects {
 public:
  explicit PdoObjects(const PdoConfig& pdo)
      : communication_(
            static_cast<std::uint16_t>((pdo.transmit ? 0x1800 : 0x1400) + pdo.number - 1)),
        mapping_(static_cast<std::uint16_t>(communication_ + 0x200)) {}

  ObjectRef id() const { return {communication_, 1, 4, false}; }
  ObjectRef transmission() const { return {communication_, 2, 1, false}; }
  ObjectRef event_timer() const { return {communication_, 5, 2, false}; }
  ObjectRef count() const { return {mapping_, 0, 1, false}; }
  ObjectRef entry(std::size_t i) const {
    return {mapping_, static_cast<std::uint8_t>(i + 1), 4, false};
  }

 private:
  std::uint16_t communication_;
  std::uint16_t mapping_;
};

/// Result of entry() for an object.
inline std::int64_t mapping_entry(const ObjectRef& object) {
  return std::int64_t{object.index} << 16 | object.sub << 8 | std::int64_t{object.bytes} * 8;
}

}  // namespace tether::cia402
