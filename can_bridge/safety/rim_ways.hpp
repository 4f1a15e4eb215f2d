#pragma once

#include <array>
#include <optional>

#include "can_bridge/drivetrain/drive_profile.hpp"
#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// The ways of one wheel's rim in one cycle, m, and its setpoint, m/s.
struct RimWays {
  double dt_s = 0.0;
  double told_mps = 0.0;
  double told_m = 0.0;
  double reported_m = 0.0;  ///< by the speed that its drive reports
  double counted_m = 0.0;   ///< by its position counter
};

/// Samples both wheels' feedback, once per cycle.
class RimSampler {
 public:
  RimSampler(double track_m, double wheel_radius_m)
      : track_m_(track_m), wheel_radius_m_(wheel_radius_m) {}

  /// The next update() begins again.
  void reset() { last_.reset(); }
  /// Whether the next update() begins again.
  bool begins() const { return !last_; }
  /// `setpoint`: in force since the last call. The ways since then, left and right; nullopt in the
  /// first call, and while feedback is not valid, which begins again.
  std::optional<std::array<RimWays, 2>> update(Instant now, const Twist& setpoint,
                                               const std::array<WheelFeedback, 2>& wheels);

 private:
  struct Sample {
    Instant stamp{};
    std::array<double, 2> angle_rad{};
  };

  double track_m_;
  double wheel_radius_m_;
  std::optional<Sample> last_;
};

/// "left", "right".
inline const char* side_name(std::size_t wheel) { return wheel == 0 ? "left" : "right"; }

}  // namespace tether
