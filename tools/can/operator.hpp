#pragma once

#include <cstdint>
#include <string>

namespace tether {

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
