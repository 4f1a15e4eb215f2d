#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tests/campaign/record.hpp"

namespace tether::campaign {

/// The first place where a record breaks a rule.
struct Violation {
  Instant when;
  std::string what;
};

/// Rule that must hold in every run, whatever goes wrong. Rules see only what was published, what
/// was on the bus, how the wheels truly turned and what was sent: nothing of the bridge's insides.
struct Rule {
  const char* name;
  std::optional<Violation> (*broken)(const Record&);
};
const std::vector<Rule>& rules();

// rules_motion.cpp: of the wheels.

/// Outside ARMED the wheels come to rest within the braking time and way, and stay so.
std::optional<Violation> wheels_turn_unarmed(const Record& record);
/// The same from can.stale_ms after the newest command that may have been genuine.
std::optional<Violation> wheels_turn_on_old_commands(const Record& record);
/// The same for each wheel from kDriveDeadline after its drive's last setpoint.
std::optional<Violation> wheel_turns_without_setpoints(const Record& record);
/// On plans, wheels stand can.max_blind_s after the newest pose that a plan was made from.
std::optional<Violation> blind_for_too_long(const Record& record);
/// On plans, the vehicle goes no farther than can.max_blind_m from that pose on.
std::optional<Violation> blind_too_far(const Record& record);
/// When all have been quiet for a while, the wheels stand and nothing is armed or stops.
std::optional<Violation> no_rest_at_the_end(const Record& record);

// rules_truth.cpp: of what the bridge believes, against how the wheels truly turn.

/// The bridge takes power from no wheel that turns, and resets none of its drives.
std::optional<Violation> power_cut_while_turning(const Record& record);
/// DISARMED and ARMED begin only while the wheels truly stand.
std::optional<Violation> standstill_reported_while_turning(const Record& record);
/// While ARMED, each wheel's speed and direction are among those of the setpoints of the last
/// 0.3 s, within 0.2 m/s.
std::optional<Violation> armed_wheel_not_as_told(const Record& record);

// rules_state.cpp: of states and setpoints.

/// Published setpoints are zero unless ARMED or STOPPING, finite, and within the limits.
std::optional<Violation> setpoint_forbidden(const Record& record);
/// The same for the frames that the bridge sends: zero unless ARMED or STOPPING.
std::optional<Violation> frame_forbidden(const Record& record);
/// ESTOP and DISARM end ARMED in the next cycle.
std::optional<Violation> stop_not_obeyed(const Record& record);
/// ARMING begins only by an ARM that is fresh and new, never from FAULT, ESTOP or REFUSED; ARMED
/// only after ARMING.
std::optional<Violation> armed_without_request(const Record& record);
/// ARMED begins only with a command that is fresh and says zero.
std::optional<Violation> armed_without_zero(const Record& record);
/// Commands older than can.disarm_ms end ARMED.
std::optional<Violation> armed_on_old_commands(const Record& record);
/// FAULT is left only by a RESET that is fresh and new.
std::optional<Violation> fault_left(const Record& record);
/// After ESTOP, only RELEASE and then RESET lead out of STOPPING and ESTOP.
std::optional<Violation> estop_left(const Record& record);
/// Faults of drives and bus end ARMED within the documented time.
std::optional<Violation> fault_unnoticed(const Record& record);
/// So does an encoder that stands still.
std::optional<Violation> frozen_encoder_unnoticed(const Record& record);

}  // namespace tether::campaign
