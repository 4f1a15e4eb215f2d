#pragma once

#include <cstdint>
#include <vector>

#include "can_bridge/bus/object_dictionary.hpp"
#include "can_bridge/cia402/config.hpp"

namespace tether {

/// Where an axis of an emulated drive has its objects. kNone: the drive has no such object.
struct AxisObjects {
  using Handle = ObjectDictionary::Handle;

  std::size_t wheel = 0;  ///< 0 left, 1 right
  int sign = 1;
  double target_per_radps = 1.0;  ///< units of target velocity per rad/s, without sign
  double actual_per_radps = 1.0;
  double counts_per_rad = 1.0;
  int statusword_shift = 0;
  int error_code_shift = 0;

  Handle controlword = ObjectDictionary::kNone;
  Handle statusword = ObjectDictionary::kNone;
  Handle mode = ObjectDictionary::kNone;
  Handle mode_display = ObjectDictionary::kNone;
  Handle target_velocity = ObjectDictionary::kNone;
  Handle actual_velocity = ObjectDictionary::kNone;
  Handle actual_position = ObjectDictionary::kNone;
  Handle error_code = ObjectDictionary::kNone;
  Handle max_speed = ObjectDictionary::kNone;                ///< 0x607F
  Handle acceleration = ObjectDictionary::kNone;             ///< 0x6083
  Handle deceleration = ObjectDictionary::kNone;             ///< 0x6084
  Handle quick_stop_deceleration = ObjectDictionary::kNone;  ///< 0x6085
  Handle connection_option = ObjectDictionary::kNone;        ///< 0x6007
  Handle quick_stop_option = ObjectDictionary::kNone;        ///< 0x605A
  Handle fault_option = ObjectDictionary::kNone;             ///< 0x605E
};

/// The object dictionary of one emulated drive.
struct DriveObjects {
  using Handle = ObjectDictionary::Handle;

  ObjectDictionary dictionary;
  std::vector<AxisObjects> axes;  ///< one or two
  Handle error_register = ObjectDictionary::kNone;
  Handle heartbeat_time = ObjectDictionary::kNone;
  Handle error_behaviour = ObjectDictionary::kNone;  ///< 0x1029:1
  std::vector<Handle> heartbeat_consumers;           ///< 0x1016:1…
  std::vector<Handle> watchdogs;                     ///< vendor's, in milliseconds
};

/// Objects of the device with id `node`: CiA 301's objects of every device (0x1000, 1001, 1005,
/// 1008, 1014, 1017, 1018, 1200, four RPDOs and four TPDOs), all that `config` mentions for this
/// node, and these companions of each axis: 0x6502, 607F, 6083, 6084, 6085, at the index offset and
/// subindex that its target velocity has (axis 2 of one node: +0x800, or subindex 2). Nothing else:
/// 0x1016, 1029, 6007, 605A and 605E are there only if `config` mentions them, as in real drives.
/// An axis without a 0x6007 of its own obeys the device's.
///
/// Sizes and signs are the config's, except in 0x1000…0x1FFF, where they are CiA 301's.
///
/// After power-on: no watchdog, no heartbeat, mode 0, ramps of 2 (6083, 6084) and 4 (6085) wheel
/// revolutions/s², 607F at 1000 rpm of the wheel. PDOs that the config calls preset are ready; of
/// the others RPDO1 carries the controlword and TPDO1 the statusword (CiA 402's defaults), the rest
/// are off.
///
/// A 32-bit object that a PDO or setup write mentions, beside two axes' 16- or 32-bit objects of
/// the same index and other subindices, holds both as halves, the lower subindex in the lower half.
DriveObjects make_drive_objects(const Cia402Config& config, std::uint8_t node);

}  // namespace tether
