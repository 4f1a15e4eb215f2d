#include "tools/can/request_outcome.hpp"

#include <cassert>
#include <tether/drive_request_t.hpp>

namespace tether {

RequestOutcome judge_request(std::int32_t request, const drivetrain_state_t& state,
                             Duration since_request) {
  using State = drivetrain_state_t;
  using enum RequestOutcome;
  const std::int32_t s = state.state;
  // A state from before the bridge had time to react says nothing.
  const RequestOutcome otherwise = since_request < kReactionTime ? pending : refused;
  switch (request) {
    case drive_request_t::ARM:
      if (s == State::ARMED) return reached;
      return s == State::ARMING ? pending : otherwise;
    case drive_request_t::DISARM:
      if (s == State::STOPPING) return pending;
      return s == State::ARMED || s == State::ARMING ? otherwise : reached;
    case drive_request_t::ESTOP:
      if (s == State::ESTOP) return reached;
      return s == State::STOPPING ? pending : otherwise;
    case drive_request_t::ESTOP_RELEASE:
      if (s != State::ESTOP || !state.reason.starts_with("e-stop pressed")) return reached;
      return otherwise;
    case drive_request_t::RESET:
      if (s == State::DISARMED) return reached;
      return s == State::STARTING ? pending : otherwise;
    default:
      assert(!"a constant of drive_request_t");
      return refused;
  }
}

}  // namespace tether
