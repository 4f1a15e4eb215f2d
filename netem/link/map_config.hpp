#pragma once

#include <string>
#include <vector>

namespace tether {

/// Conditions by the vehicle's position: netem/models/map_process.hpp has the formulas. SNR comes
/// from a file or from access points, one of the two.
struct MapConfig {
  std::string file;  ///< grid of SNR in dB, Esri ASCII raster (netem/models/position_map.hpp)
  /// [[x_m, y_m], …] in the world's frame, or [[x_m, y_m, snr_1m_db], …].
  std::vector<std::vector<double>> access_points;
  double snr_1m_db = 60.0;          ///< access points: SNR at 1 m, where they do not give their own
  double path_loss_exponent = 3.0;  ///< access points
  double handover_s = 0.0;          ///< access points: nothing gets through for so long at a change
  double shadowing_sd_db = 0.0;     ///< log-normal shadowing: standard deviation; 0 = none
  double shadowing_distance_m = 10.0;  ///< at which its correlation has fallen to 1/e

  double snr50_db = 10.0;  ///< logistic curve: SNR at which half of the packets get through
  double slope_db = 1.0;   ///< logistic curve: prr = 1/(1 + exp(−(snr − snr50)/slope))
  std::vector<std::vector<double>> prr_curve;  ///< instead: [[snr_db, prr], …], linear between
  double delay_ms = 0.0;
  std::vector<std::vector<double>> delay_curve;  ///< instead: [[snr_db, delay_ms], …]

  bool operator==(const MapConfig&) const = default;
};

}  // namespace tether
