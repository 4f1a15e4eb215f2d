#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "common/base/counters.hpp"
#include "common/base/time.hpp"
#include "common/node/sole_sender.hpp"
#include "doors/ros2/cdr_reader.hpp"

namespace tether {

/// Decides which commands of ROS 2 go on to the vehicle. A command is refused, and counted, when it
/// - `several`: comes while two publishers or more send on the topic (SenderWatch): none of them
///   drives, so that the vehicle stops by its own time-out;
/// - `undecodable`: is no Twist or TwistStamped;
/// - `non_finite`: has NaN, infinity or a number that is too large in any of its six components;
/// - `sideways`: asks for a motion that the vehicle cannot make: y, z, roll or pitch;
/// - `wrong_frame`: is stamped in a frame other than the vehicle's base frame ("" is accepted);
/// - `old`: is stamped longer than `max_age` ago; `from_future`: is stamped later than that ahead.
/// Unstamped commands have no age: what bounds it is the actuator's time-out.
class CommandGate {
 public:
  struct Config {
    std::string frame = "base_link";
    Duration max_age = std::chrono::milliseconds{500};
    std::int64_t shift_ns = 0;  ///< stamp of the run's t = 0
  };

  explicit CommandGate(Config config) : config_(std::move(config)) {}

  /// The twist, if it goes on. `publisher`: its name, not 0. `now` must not go backwards.
  std::optional<Twist> take(Instant now, std::uint64_t publisher,
                            const std::optional<RosCommand>& command);

  /// Whether several publishers send now.
  bool several(Instant now) const { return !watch_.several(now).empty(); }

  /// Appends all counters, named "ros2.accepted" and so on.
  void list(CounterList& out) const;

 private:
  Config config_;
  SenderWatch watch_;
  std::int64_t accepted_ = 0, several_ = 0, undecodable_ = 0, non_finite_ = 0, sideways_ = 0;
  std::int64_t wrong_frame_ = 0, old_ = 0, from_future_ = 0;
};

}  // namespace tether
