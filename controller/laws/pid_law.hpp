#pragma once

#include <memory>

#include "common/base/time.hpp"
#include "common/path/reference_path.hpp"
#include "common/vehicle/pose.hpp"
#include "controller/laws/law.hpp"
#include "controller/pid/pid.hpp"

namespace tether {

/// The paper's control law: two PIDs on the errors to the point of the path τ seconds ahead,
///   θ_e = atan2(y*(t+τ) − y, x*(t+τ) − x) − θ, wrapped to (−π, π]  → ω
///         (not wrapped with wrap_heading = false, where the vehicle may turn the long way round)
///   d_e = hypot(x*(t+τ) − x, y*(t+τ) − y)                        → v
/// (x, y) is the axle's midpoint, or a point `ahead_m` ahead of it, which then is what follows the
/// path (path.point).
/// Since d_e ≥ 0 and all gains are ≥ 0, it hardly ever drives backwards.
class PidLaw : public Law {
 public:
  PidLaw(const ControllerSettings& config, std::shared_ptr<const ReferencePath> path,
         double ahead_m = 0.0);

  /// The command at `now` for a vehicle last seen at `pose`. Times of successive calls must not
  /// decrease.
  Twist step(const Pose2& pose, Instant now);
  LawOutput decide(Instant now, const SeenPose* newest) override { return step(newest->pose, now); }
  /// Forgets everything: the next step is a first one.
  void reset() override;

  /// θ_e and d_e of the last step.
  LawErrors errors() const override { return errors_; }

  void set_look_ahead(double tau_s) override { tau_s_ = tau_s; }

 private:
  std::shared_ptr<const ReferencePath> path_;
  double ahead_m_;
  double tau_s_;
  bool wrap_heading_;
  Pid v_;
  Pid omega_;
  LawErrors errors_;
  Instant last_{};
};

}  // namespace tether
