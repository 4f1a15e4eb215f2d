#pragma once

#include <optional>
#include <string>
#include <vector>

#include "netem/models/indoor_factory.hpp"

namespace tether {

/// [medium.radio]: how well stations of Wi-Fi hear each other.
struct RadioSettings {
  enum class Model {
    none,   ///< noise is only medium.error_ratio
    fixed,  ///< the same for all
    hall    ///< noise by the vehicle's position (indoor_factory.hpp)
  };
  Model model = Model::none;
  double snr_db = 30.0;  ///< fixed

  bool adapt_rate = false;           ///< medium.rate_Mbps is the highest, else the only one
  double highest_error_ratio = 0.1;  ///< adapt_rate: the best rate that loses no more frames

  /// Capture threshold for uplink frames that collide: the least ratio of signal to noise and to
  /// the others at which one is received. Not set: none is.
  std::optional<double> capture_sinr_db;

  // A hall.
  std::vector<std::vector<double>> access_points;  ///< [[x_m, y_m], …] in the world's frame
  IndoorFactory::Clutter clutter = IndoorFactory::Clutter::sparse_high;
  double carrier_GHz = 5.5;
  double power_dBm = 20.0;  ///< power of all senders, with their antennas
  /// Noise figure of all receivers, including all implementation losses.
  double noise_figure_db = 7.0;
  // With several access points.
  double roaming_hysteresis_db = 6.0;  ///< lead that another access point needs
  double roaming_break_ms = 50.0;      ///< interruption after a change
  bool roaming_waits = true;           ///< roaming_queue = "wait": what is to pass meanwhile

  // Instead of what is typical of the clutter.
  std::optional<double> clutter_density, clutter_size_m, clutter_height_m, station_height_m,
      vehicle_height_m;

  IndoorFactory hall() const;
};

}  // namespace tether
