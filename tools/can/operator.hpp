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

/// Where an operator's commands go.
struct CanOperatorOptions {
  std::string lcm_url;
  std::string vehicle = "AGV";
};

// Each prints to standard output and returns the exit code. All stop waiting after bounded time;
// std::runtime_error says whose messages are missing.

/// Asks the bridge (drive_request_t's constant) and waits until it shows what became of it, at most
/// 10 s. 0: the wanted state was reached. ESTOP and DISARM are sent at once, whether or not a
/// bridge is heard, and every 50 ms for 10 s or until its state says what they wanted; others wait
/// 2 s for its clock.
int can_request(const CanOperatorOptions& options, std::int32_t request);

/// Hold-to-run: sends ALIVE 20 times a second and shows each new state, until a signal ends it.
int can_hold(const CanOperatorOptions& options);

/// Injects a fault (drive_fault_t's kind) into the emulated drives. 0: they took it.
int can_inject(const CanOperatorOptions& options, std::int32_t node, std::int32_t kind,
               double value);

/// Shows the bridge's state, wheels and odometry, once.
int can_status(const CanOperatorOptions& options);

}  // namespace tether
