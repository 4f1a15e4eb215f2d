#pragma once

#include <array>
#include <string>

#include "can_bridge/safety/rim_ways.hpp"

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
/// witnesses may differ by kProofShare from each other and from the setpoint, which they may lag
/// behind by kLag_s, else the vehicle stops at once.
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
  static constexpr double kLag_s = 0.2;

  WitnessMonitor(double track_m, double wheel_radius_m) : sampler_(track_m, wheel_radius_m) {}

  /// When following begins.
  void reset() { sampler_.reset(); }
  /// The drives were started up: their scales have to be proven again.
  void demand_proof() { proven_ = {}; }

  /// Once per cycle, with the twist in force since the last cycle and the newest feedback. Returns
  /// what is wrong, for a technician; "" if nothing is. Invalid feedback starts it again.
  std::string update(Instant now, const Twist& setpoint,
                     const std::array<WheelFeedback, 2>& wheels);
  /// For a wheel that does not follow, as another monitor says: the same text, already from
  /// kLimit_m / 2 on; "" if the witnesses do not differ by that.
  std::string suspicion() const;

 private:
  /// Ways of one wheel's rim, m.
  struct Ways {
    double told = 0.0;      // by setpoint
    double reported = 0.0;  // by speed
    double counted = 0.0;   // by position

    void add(const RimWays& rim);
  };
  struct Wheel {
    Ways first;          // until it is proven
    double proof = 0.0;  // the longest of them, unsigned
    double more = 0.0;   // CUSUM: reported beyond counted
    double less = 0.0;
    Ways differing;  // since both sums were last zero
  };
  /// The ways that contradict each other; nullptr if none do.
  const Ways* contradiction(std::size_t i, const RimWays& rim);
  static bool agree(const Ways& ways);
  static bool follow(const Ways& ways, double told_mps);
  static std::string text(std::size_t i, const Ways& ways);
  static std::string diagnosis(const Ways& ways);

  RimSampler sampler_;
  std::array<Wheel, 2> wheels_;
  std::array<bool, 2> proven_{};
};

}  // namespace tether
