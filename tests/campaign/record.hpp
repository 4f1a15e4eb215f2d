#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/vehicle/pose.hpp"
#include "tests/campaign/trial.hpp"

namespace tether::campaign {

/// drivetrain_state_t, as published.
struct StateSample {
  Instant when;
  std::int32_t state = 0;
  Twist twist;  ///< setpoint
};

/// The emulated drives' wheels, as they truly turn.
struct WheelSample {
  Instant when;
  std::array<double, 2> rim_mps{};  ///< left, right
  std::array<bool, 2> powered{true, true};
};

/// The bridge sent a frame that takes power from a wheel, or resets its drive.
struct CutSample {
  Instant when;
  std::size_t wheel = 0;
  double rim_mps = 0.0;  ///< true speed
  bool reset = false;    ///< NMT reset; else "disable voltage" or "shutdown" of a powered axis
};

/// drive_request_t, when the bridge got it.
struct RequestSample {
  Instant when;
  std::int32_t request = 0;
  bool acts = false;  ///< fresh, and for the first time
};

/// A command that the bridge got and that it may have accepted.
struct CommandSample {
  Instant when;
  bool plan = false;
  Instant as_of;       ///< min(stamp, when); of a plan the end of its horizon
  Instant seen;        ///< plans: min(pose, stamp, when)
  Instant moves_from;  ///< says zero before; Instant::max(): always
};

/// From when on the vehicle's commands age: the latest time at which any of them could still be
/// fresh. Of a plan that is the end of its horizon, or max_blind after its pose if that is earlier.
class Freshness {
 public:
  void add(const CommandSample& command) {
    if (command.plan) {
      horizon_ = std::max(horizon_, command.as_of);
      seen_ = std::max(seen_, command.seen);
    } else {
      twist_ = std::max(twist_, command.as_of);
    }
  }
  Instant as_of(Duration max_blind) const {
    if (seen_ == Instant::min()) return twist_;
    return std::max(twist_, std::min(horizon_, seen_ + max_blind));
  }

 private:
  Instant twist_ = kStart;
  Instant horizon_ = Instant::min();
  Instant seen_ = Instant::min();
};

/// A setpoint frame as the bridge handed it to its port.
struct SetpointSample {
  Instant when;
  bool moves = false;
};

struct Interval {
  Instant from;
  Instant until;
};

/// The campaign's limits, as configured in the bridge.
struct Limits {
  Duration cycle{};
  Duration stale{};
  Duration disarm{};
  Duration max_blind{};
  double max_blind_m = 0.0;
  double track_m = 0.0;
  double max_speed_mps = 0.0;
  double max_yaw_rate_radps = 0.0;
  double acceleration_mps2 = 0.0;
  double yaw_acceleration_radps2 = 0.0;
  double deceleration_mps2 = 0.0;
  double yaw_deceleration_radps2 = 0.0;
};

/// Record of a run, on which rules are checked.
struct Record {
  Limits limits;
  std::vector<StateSample> states;
  std::vector<WheelSample> wheels;
  std::vector<RequestSample> requests;
  std::vector<CommandSample> commands;
  std::vector<SetpointSample> setpoints;
  std::vector<CutSample> cuts;
  std::array<std::vector<Instant>, 2> heard;  ///< setpoints on the bus, of each drive
  std::vector<Instant> foreign;   ///< times at which an unknown sender commands the drives
  std::vector<Interval> stalls;   ///< pauses of the bridge
  std::vector<Instant> restarts;  ///< a new bridge lives from here on
  std::vector<Fault> faults;      ///< applied faults, with their ends
  Instant quiet;
  Instant end;

  // For the report.
  std::vector<std::string> stops;  ///< reasons for which ARMED was left
  double armed_s = 0.0;
  double driven_m = 0.0;
  std::vector<std::string> notes;  ///< the time line, if wanted
};

}  // namespace tether::campaign
