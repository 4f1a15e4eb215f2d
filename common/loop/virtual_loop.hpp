#pragma once

#include "common/loop/simulated_loop.hpp"

namespace tether {

/// Simulated time: jumps from event to event, as fast as the CPU goes. Deterministic: events
/// run in order of (time, priority, insertion), in the calling thread.
class VirtualLoop final : public SimulatedLoop {
 public:
  explicit VirtualLoop(Instant start = kStart) : SimulatedLoop(start) {}

  void stop() override { stopped_ = true; }

  /// Runs all events up to and including `end`, then sets the time to `end`. Returns early,
  /// with the time of the last event, if a task called stop() or threw.
  void run_until(Instant end);

 private:
  bool stopped_ = false;
};

}  // namespace tether
