#pragma once

#include <memory>

#include "common/pose.hpp"
#include "common/reference_path.hpp"
#include "common/scenario.hpp"
#include "common/time.hpp"
#include "controller/pid.hpp"

namespace tether {

/// The paper's control law: two PIDs on the errors to the point of the path τ seconds ahead,
///   θ_e = atan2(y*(t+τ) − y, x*(t+τ) − x) − θ, wrapped to (−π, π]  → ω
///         (not wrapped with wrap_heading = false, where the vehicle may turn the long way round)
///   d_e = hypot(x*(t+τ) − x, y*(t+τ) − y)                        → v
/// Since d_e ≥ 0 and all gains are ≥ 0, it hardly ever drives backwards.
class PidLaw {
 public:
  struct Errors {
    double heading_rad = 0.0;  ///< θ_e
    double distance_m = 0.0;   ///< d_e
  };

  PidLaw(const Scenario::Controller& config, std::shared_ptr<const ReferencePath> path);

  /// The command at `now` for a vehicle last seen at `pose`. Times of successive calls must not
  /// decrease.
  Twist step(const Pose2& pose, Instant now);
  /// Forgets everything: the next step is a first one.
  void reset();

  /// Errors of the last step.
  const Errors& errors() const { return errors_; }

 private:
  std::shared_ptr<const ReferencePath> path_;
  double tau_s_;
  bool wrap_heading_;
  Pid v_;
  Pid omega_;
  Errors errors_;
  Instant last_{};
};

}  // namespace tether
