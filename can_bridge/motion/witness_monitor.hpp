#pragma once

#include <array>
#include <optional>
#include <string>

#include "can_bridge/drivetrain/drive_profile.hpp"
#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// Compares the two witnesses of each wheel while the vehicle drives, the speed that its drive
/// reports and its position counter, with each other and with the setpoint. FollowMonitor needs the
/// positions to be right; this notices when one of both is not, and says which.
///
/// For each wheel the difference between the way by speed and the way by position is added up, less
/// kAllowedShare of the longer one and kAllowed_mps, never below zero, for each sign (a one-sided
/// CUSUM test as in FollowMonitor). At kLimit_m the witnesses contradict each other. A speed that
/// reads zero is noticed after 0.23 m, one of reversed sign after 0.11 m, one that is wrong by a
/// third after 0.9 m; the smallest error that is seen is 10 % + 0.02 m/s. A speed that lags 50 ms
/// behind passes up to 3 m/s.
///
/// After a start-up of the drives, the first kProof_m of each wheel prove the scales: there the
/// witnesses may differ by kProofShare, else the vehicle stops at once.
///
/// What physics does not tell apart is named together: an encoder that serves both witnesses and
/// slips, wheels that slip on the floor, and a wrong scale of both look the same to them.
class WitnessMonitor {
 public:
  static constexpr double kAllowedShare = 0.1;
  static constexpr double kAllowed_mps = 0.02;
  static constexpr double kLimit_m = 0.2;
  static constexpr double kProof_m = 0.2;
  static constexpr double kProofShare = 0.3;

  WitnessMonitor(double track_m, double wheel_radius_m)
      : track_m_(track_m), wheel_radius_m_(wheel_radius_m) {}

  /// When following begins.
  void reset() { last_.reset(); }
  /// The drives were started up: their scales have to be proven again.
  void demand_proof() { proven_ = {}; }

  /// Once per cycle, with the twist in force since the last cycle and the newest feedback. Returns
  /// what is wrong, for a technician; "" if nothing is. Invalid feedback starts it again.
  std::string update(Instant now, const Twist& setpoint,
                     const std::array<WheelFeedback, 2>& wheels);

 private:
  struct Sample {
    Instant stamp{};
    std::array<double, 2> angle_rad{};
  };
  /// Ways of one wheel's rim, m.
  struct Ways {
    double told = 0.0;      // by setpoint
    double reported = 0.0;  // by speed
    double counted = 0.0;   // by position
    double proof = 0.0;     // the longest of them, unsigned, since the proof was demanded
    double more = 0.0;      // CUSUM: reported beyond counted
    double less = 0.0;
  };
  bool contradicts(std::size_t i, double told_m, double reported_m, double counted_m, double dt_s);
  static std::string diagnosis(const Ways& ways);

  double track_m_;
  double wheel_radius_m_;
  std::optional<Sample> last_;
  std::array<Ways, 2> ways_;
  std::array<bool, 2> proven_{};
};

}  // namespace tether
