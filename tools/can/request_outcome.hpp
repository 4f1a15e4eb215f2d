#pragma once

#include <cstdint>
#include <string>
#include <tether/drivetrain_state_t.hpp>

#include "common/base/time.hpp"

namespace tether {

/// Outcome of an operator's request, as far as the bridge's state shows.
enum class RequestOutcome {
  pending,  ///< wait for a later state
  reached,  ///< the drivetrain is where the request wanted it
  refused,  ///< it is not, and will not get there by itself: see the state's reason
};

/// How long the bridge may take to react: ten control cycles of 20 ms.
inline constexpr Duration kReactionTime = std::chrono::milliseconds{200};

/// `request`: a constant of drive_request_t; `since_request`: between the request's stamp and
/// the state's, both of the bridge's clock.
/// - ARM: reached when armed. DISARM: when neither armed nor stopping.
/// - ESTOP: when the e-stop is latched and the vehicle has been stopped (state estop).
/// - ESTOP_RELEASE: when the state is not estop, or its reason no longer says that the e-stop is
///   pressed.
/// - RESET: when disarmed; before that, the drives may have to start up.
RequestOutcome judge_request(std::int32_t request, const drivetrain_state_t& state,
                             Duration since_request);

}  // namespace tether
