#pragma once

#include "common/base/random.hpp"
#include "netem/models/shadowing.hpp"

namespace tether {

/// Radio in a factory hall: 3GPP TR 38.901 V16.1, 7.4, scenarios InF, 0.5 to 100 GHz.
struct IndoorFactory {
  /// Table 7.2-4: clutter sparse or dense; base station low (within it) or high (above it).
  enum class Clutter { sparse_low, dense_low, sparse_high, dense_high };

  Clutter clutter = Clutter::sparse_high;
  double carrier_GHz = 5.5;
  double station_height_m = 8.0;  ///< height of the base station or access point
  double vehicle_height_m = 1.5;  ///< height of the vehicle's antenna
  double clutter_height_m = 2.0;
  double clutter_size_m = 10.0;  ///< d_clutter
  double clutter_density = 0.2;  ///< r: share of the floor, 0 < r < 1

  /// With the table's typical values of height, size, density and station height.
  static IndoorFactory of(Clutter clutter, double carrier_GHz);

  bool station_is_high() const {
    return clutter == Clutter::sparse_high || clutter == Clutter::dense_high;
  }
  /// Over the floor `distance_m` apart, at least 1 m: table 7.4.2-1. High stations: the line leaves
  /// the clutter on its way.
  double los_probability(double distance_m) const;
  /// Table 7.4.1-1, without shadowing.
  double path_loss_db(double distance_m, bool line_of_sight) const;
  /// Standard deviation of the shadowing, ibid.
  double shadowing_sd_db(bool line_of_sight) const;
};

/// One realisation of a hall for one station: which places see it, and how far shadowed they are,
/// as functions of the position alone. Line of sight holds where a Gaussian field, correlated over
/// d_clutter/2 (7.6.3.3), is below the quantile that the probability at this distance asks for.
class IndoorFactoryMap {
 public:
  /// Correlation of shadowing: 10 m (table 7.5-6).
  IndoorFactoryMap(const IndoorFactory& hall, double station_x_m, double station_y_m,
                   RandomEngine& random);

  bool line_of_sight(double x_m, double y_m) const;
  /// With shadowing.
  double path_loss_db(double x_m, double y_m) const;

 private:
  double distance_m(double x_m, double y_m) const;

  IndoorFactory hall_;
  double x_m_, y_m_;
  Shadowing sight_, shadow_;  ///< both of standard deviation 1
};

}  // namespace tether
