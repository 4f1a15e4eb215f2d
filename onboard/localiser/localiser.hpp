#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "common/base/counters.hpp"
#include "common/base/random.hpp"
#include "common/world/onboard_settings.hpp"
#include "common/world/scan.hpp"
#include "onboard/localiser/pose_search.hpp"
#include "onboard/localiser/pose_tracker.hpp"

namespace tether {

/// Where the vehicle is at the end of a scan, and how sure that is.
struct Localisation {
  enum class State {
    searching,   ///< it does not know: pose and covariance say nothing
    tracking,    ///< all is known by the last scan
    degenerate,  ///< one direction or the yaw, or all, by odometry alone
  };
  State state = State::searching;
  Instant stamp;
  Pose2 pose;
  PoseCovariance covariance;
  Weakness weak;               ///< weakness of the last scan alone
  std::int64_t scan_seq = -1;  ///< number of the last scan that was used
  int beams = 0;               ///< number of used beams of the last scan
  int outside = 0;             ///< number of beams that hit objects outside the map
  double residual_m = 0.0;
};

/// Poses from scans and odometry, in a map: matches each scan near where odometry says, or searches
/// where it is.
///
/// A scan whose match is far from what odometry says is not used, nor one of which fewer beams fit
/// than kLeastShare: of all, or, if at least kLeastSeen of all fit, of those that fit or went
/// through what the map shows, for the others may have met something new. Then odometry goes on
/// alone. After kMostMisses of them in a row, or when the position is known less well than kLost_m,
/// it is lost and searches: so a vehicle that was carried elsewhere is noticed. Scans of
/// fewer than kLeastBeams beams are not used and no misses. It tracks again from where the search
/// is sure. kStrays matches in a row that odometry contradicts, but which nearly all beams fit, are
/// taken at their word.
///
/// Pure: no clock; `random` is for the search. Odometry and scans come in the order of their
/// stamps.
class Localiser {
 public:
  static constexpr int kMostMisses = 6;
  static constexpr double kLost_m = 0.3;
  /// Beams that fit, of all, for a scan to be used.
  static constexpr double kLeastShare = 0.5;
  static constexpr double kLeastSeen = 0.2;
  static constexpr int kStrays = 3;
  static constexpr double kStrayShare = 0.8;
  static constexpr int kLeastBeams = LocaliserSettings::kLeastBeams;
  /// Standard deviation above which a direction is degenerate for a scan alone.
  static constexpr double kWeak_m = 0.1;
  static constexpr double kWeak_rad = 0.03;

  struct Settings {
    PoseTracker::Settings tracker;
    PoseSearch::Settings search;  ///< its match's settings are those of tracking, too
    std::size_t max_beams = 1000;
    /// nullopt: it has to find out where it is.
    std::optional<Pose2> start;
    double start_error_m = 0.05;  ///< standard deviations, each axis
    double start_error_rad = 0.02;
  };

  Localiser(const Settings& settings, std::shared_ptr<const DistanceField> field,
            RandomEngine random);

  void on_odometry(const OdometryReading& reading);
  /// A scan that ends later than those before.
  Localisation on_scan(const Scan& scan);

  /// Appends "match.accepted", "match.gated", "match.poor", "match.nis_per_mille" (of 3000 if all
  /// is as assumed), "localiser.lost" and "localiser.found".
  void list_counters(CounterList& out) const;

 private:
  void move_to(Instant when);
  OdometryTrack::Point wheels_at(Instant when) const;
  void track(const Scan& scan, std::span<const Beam> beams, Localisation& out);
  void search(const Scan& scan, std::span<const Beam> beams, Localisation& out);
  bool use(const Scan& scan, std::span<const Beam> beams, const Match& match);
  bool fits(std::span<const Beam> beams, const Match& match) const;
  void lose(const Match& match);

  Settings settings_;
  std::shared_ptr<const DistanceField> field_;
  OdometryTrack odometry_;
  PoseSearch search_;
  std::optional<PoseTracker> tracker_;  ///< nullopt: it searches
  std::optional<Instant> known_at_;     ///< the middle of the last scan
  std::int64_t last_used_ = -1;
  int misses_ = 0;  ///< in a row
  int strays_ = 0;  ///< in a row
  std::int64_t accepted_ = 0, gated_ = 0, poor_ = 0, lost_ = 0, found_ = 0;
  double sum_nis_ = 0.0;
};

}  // namespace tether
