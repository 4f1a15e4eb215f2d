#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "can_bridge/bus/object_ref.hpp"

namespace tether {

/// Content of an electronic data sheet (EDS) or a device configuration file (DCF) of a CANopen
/// device, as far as a drivetrain file depends on it. Their form is CiA 306-1's.
struct EdsFile {
  struct Object {
    ObjectRef ref;  ///< `bytes` is 0 if the object is no integer of 1, 2 or 4 bytes
    std::string name;
    bool mappable = false;                ///< into a PDO
    bool writable = true;                 ///< unless AccessType is `ro` or `const`
    std::optional<std::int64_t> value{};  ///< a DCF's; numbers that contain $NODEID are left out
    std::optional<std::int64_t> default_value{};
  };

  std::string vendor, product;
  std::optional<std::int64_t> node;                         ///< a DCF's
  std::map<std::pair<std::uint16_t, int>, Object> objects;  ///< by index and subindex

  /// Null if the device has none.
  const Object* find(std::uint16_t index, int sub = 0) const;
};

/// Throws UsageError that names `file` and the line. Sections and keys that say nothing to us are
/// skipped, whatever they contain.
EdsFile read_eds(const std::string& text, const std::string& file);

}  // namespace tether
