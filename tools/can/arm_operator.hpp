#pragma once

#include <cstdint>
#include <string>

#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/stream_guard.hpp"
#include "common/scenario/scenario.hpp"

namespace tether {

/// The run's own operator (can.arm = once): presses "arm" every kPatience while the drivetrain is
/// ready, until it has been armed once in this run. It never does so again: a vehicle that has been
/// stopped stays stopped.
class ArmOperator {
 public:
  static constexpr Duration kPatience = std::chrono::milliseconds{200};

  /// Does nothing with can.arm = never or a direct drivetrain.
  ArmOperator(const Scenario& scenario, EventLoop& loop, Bus& bus);
  ArmOperator(const ArmOperator&) = delete;
  ArmOperator& operator=(const ArmOperator&) = delete;

 private:
  void on_state(std::int32_t state);

  EventLoop& loop_;
  Bus& bus_;
  std::string request_channel_;
  StreamGuard guard_;
  Instant last_press_;
  bool done_ = false;
  std::int64_t seq_ = 0;
  std::int64_t undecodable_ = 0;
};

}  // namespace tether
