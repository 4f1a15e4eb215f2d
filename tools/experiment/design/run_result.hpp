#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tether {

/// What is kept of each run of a sweep, in this order.
inline constexpr std::array<std::string_view, 11> kMetricNames{
    "epsilon_m",     "rmse_m",        "max_error_m",           "wall_contact_s",
    "aoi_ms_mean",   "uplink_sent",   "uplink_lost",           "uplink_delay_ms_mean",
    "downlink_sent", "downlink_lost", "downlink_delay_ms_mean"};

/// The place of a metric in kMetricNames; nullopt if there is none of that name.
std::optional<std::size_t> metric_number(std::string_view name);

/// A vehicle's state at one time.
struct TrajectoryPoint {
  float t_s, x_m, y_m, x_ref_m, y_ref_m, error_m;
  float uplink_state, downlink_state;  ///< as last reported: 0 good, 1 bad

  bool operator==(const TrajectoryPoint&) const = default;
};

/// A run of a sweep.
struct RunResult {
  std::array<double, kMetricNames.size()> metrics{};
  std::vector<TrajectoryPoint> trajectory;
  std::string failure;  ///< why there are no metrics; empty if there are

  bool operator==(const RunResult&) const = default;
};

}  // namespace tether
