#pragma once

#include "common/pose.hpp"
#include "common/scenario.hpp"
#include "common/time.hpp"

namespace tether {

/// What the vehicle does with the commands that reach it.
/// `hold` (the paper): the last command stays in force until the next one.
/// `zero`: a command stays in force for timeout_s after its arrival, then the twist is zero.
/// Before the first command the twist is zero.
class Actuator {
 public:
  explicit Actuator(const Scenario::Actuator& config);

  void on_command(Instant now, const Twist& command);

  /// The twist to realise at `now`.
  Twist in_force(Instant now) const;

 private:
  bool has_timeout_;
  Duration timeout_;
  Twist command_;
  Instant arrival_ = kStart;
};

}  // namespace tether
