#pragma once

#include "common/base/time.hpp"

namespace tether {

/// By how much the vehicle's clock is ahead of the controller's.
///
/// Nothing in poses and plans shows it by itself: stamps of poses and starts of plans are by the
/// same clock, so the vehicle is where it should be, but by its own clock: v · offset away. Only
/// delays bound it, for none is negative: a pose that took `up` by stamp and arrival, and a plan
/// that took `down` by when it was sent and when it was on board, give
///   up = δ_up − offset,   down = δ_down + offset,   so −up ≤ offset ≤ down.
/// Where the two directions take equally long, offset = (down − up)/2, as in NTP (RFC 5905, section
/// 8); where they do not, it is wrong by half the difference. When a plan was on board is known to
/// lie between two poses. The estimate is the middle, drawn to 0 by how wide that interval is:
/// the offset is taken for normal with kPrior_s before, the measurement for uniform. An
/// interval of more than ± kWidest_s says nothing: so it mostly is with one pose a second. The
/// estimate stays within the bounds, and ± kMost.
class ClockEstimate {
 public:
  static constexpr double kPrior_s = 0.05;
  static constexpr double kWidest_s = 0.03;
  static constexpr Duration kSame = std::chrono::milliseconds{3};
  static constexpr Duration kMost = std::chrono::milliseconds{200};

  /// Arrival minus stamp of a pose, without what the sensor took.
  void add_up(Duration up);
  /// A plan that was not on board `earliest` after it was sent, but was at `latest`.
  void add_down(Duration earliest, Duration latest);

  /// 0 before there is one of each.
  Duration offset() const;
  /// `used`, unless that is off by more than kSame: plans that differ are not consistent, so a
  /// change that is too small to matter is left.
  Duration near(Duration used) const;

 private:
  Duration up_ = Duration::max();          // the shortest
  Duration down_most_ = Duration::max();   // the lowest upper bound
  Duration down_least_ = Duration::min();  // the highest lower bound
};

}  // namespace tether
