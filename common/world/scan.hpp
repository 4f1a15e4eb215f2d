#pragma once

#include <cstdint>
#include <optional>
#include <tether/scan_part_t.hpp>
#include <tether/scan_t.hpp>
#include <vector>

#include "common/base/time.hpp"
#include "common/vehicle/plan.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// One turn of a laser scanner, or what arrived of it: a scan_t.
struct Scan {
  Instant stamp;  ///< time of the first beam
  std::int64_t seq = 0;
  Pose2 mount;  ///< pose of the scanner in the vehicle's frame (axle's midpoint)
  double angle_min_rad = 0.0;
  double angle_increment_rad = 0.0;
  double time_increment_s = 0.0;
  double range_min_m = 0.0;
  double range_max_m = 0.0;
  PlanName plan;               ///< from the last beam on
  std::vector<float> range_m;  ///< 0: nothing came back, or the beam did not arrive

  /// Scanner's frame.
  double angle_rad(std::size_t beam) const {
    return angle_min_rad + angle_increment_rad * static_cast<double>(beam);
  }
  Instant time_of(std::size_t beam) const {
    return stamp + from_seconds(time_increment_s * static_cast<double>(beam));
  }
  Instant end() const { return range_m.empty() ? stamp : time_of(range_m.size() - 1); }
};

scan_t scan_message(const Scan& scan, std::int64_t run);
/// nullopt if it says nothing usable: no beams or too many, numbers that are not finite, a negative
/// range, no angle between beams, a turn that takes longer than kLongestScan.
std::optional<Scan> to_scan(const scan_t& message);

inline constexpr Duration kLongestScan = std::chrono::seconds{60};

/// The scan in parts of at most `max_bytes` as LCM encodes them, but of one beam at least, and of
/// equal size as far as possible; numbered from `first_seq` on. Ranges are rounded to steps of
/// `step_m` > 0; what is beyond the largest number of steps is left out, as if nothing came back:
/// choose steps of range_max_m / kMostRangeSteps or more.
std::vector<scan_part_t> scan_parts(const Scan& scan, std::int64_t run, std::int64_t first_seq,
                                    std::size_t max_bytes, double step_m);

inline constexpr double kMostRangeSteps = 32767.0;

/// Puts parts together again. A scan is ready when all parts are there, or with what has arrived
/// when a part of a later scan comes or when it is asked for what is overdue; beams that did not
/// arrive are 0. Which scan is later, its stamp says: it is for the caller to refuse parts from the
/// future. Parts of scans that were ready before, and those that say what is known, are counted and
/// change nothing; so are those that are no part of a scan, or say something else of it than its
/// first.
class ScanAssembly {
 public:
  /// `patience`: how long after a scan's end its missing parts are waited for.
  explicit ScanAssembly(Duration patience) : patience_(patience) {}

  /// The scan that is ready by this part. If that is an incomplete one and the part by itself the
  /// whole of the next, this one is ready with overdue() at once.
  std::optional<Scan> add(const scan_part_t& part);
  /// When overdue() is ready, if a scan is unfinished.
  std::optional<Instant> deadline() const;
  std::optional<Scan> overdue(Instant now);

  std::int64_t complete() const { return complete_; }
  std::int64_t incomplete() const { return incomplete_; }
  std::int64_t late_parts() const { return late_parts_; }
  std::int64_t duplicated_parts() const { return duplicated_parts_; }
  std::int64_t unusable_parts() const { return unusable_parts_; }

 private:
  bool begun_by(const Scan& part) const;
  std::optional<Scan> take();

  Duration patience_;
  std::optional<Scan> pending_;
  std::vector<bool> arrived_;  ///< beams of it
  std::size_t missing_beams_ = 0;
  std::optional<Instant> newest_done_;  ///< stamp of the last scan that was ready
  std::int64_t complete_ = 0, incomplete_ = 0;
  std::int64_t late_parts_ = 0, duplicated_parts_ = 0, unusable_parts_ = 0;
};

}  // namespace tether
