#pragma once

#include <cstddef>
#include <optional>

#include "can_bridge/cia402/drives/drives.hpp"
#include "can_bridge/cia402/profile/fault_latch.hpp"

/// Faults of supervised drives; nullopt: nothing.
namespace tether::cia402 {

/// In every tick: drives without heartbeat; while enabling or enabled, feedback that is too old. A
/// node without heartbeat has no known state any more.
std::optional<Fault> watch(Drives& drives, Instant now);

/// After each feedback: Fault in its statusword, another mode of operation (a drive may show none
/// until it is enabled, if it did so in its start-up), OperationEnabled left or power stage on
/// unasked.
std::optional<Fault> check_axis(const Drives& drives, std::size_t i);

/// The fault of an axis whose drive shows another mode of operation than profile velocity.
Fault wrong_mode(const Axis& axis);

}  // namespace tether::cia402
