#include "netem/models/indoor_factory.hpp"

#include <algorithm>
#include <boost/math/distributions/normal.hpp>
#include <cmath>

namespace tether {
namespace {

constexpr double kNearest_m = 1.0;
constexpr double kShadowingDistance_m = 10.0;

/// A·lg(distance) + the rest: of one row of table 7.4.1-1.
struct PathLoss {
  double at_1_m_db, slope_db, frequency_db, shadowing_sd_db;
};
constexpr PathLoss kLineOfSight{31.84, 21.50, 19.00, 4.3};

const PathLoss& without_sight(IndoorFactory::Clutter clutter) {
  static constexpr PathLoss kRows[] = {{33.0, 25.5, 20.0, 5.7},    // sparse clutter, low station
                                       {18.6, 35.7, 20.0, 7.2},    // dense, low
                                       {32.4, 23.0, 20.0, 5.9},    // sparse, high
                                       {33.63, 21.9, 20.0, 4.0}};  // dense, high
  return kRows[static_cast<int>(clutter)];
}

double loss_db(const PathLoss& row, double distance_m, double carrier_GHz) {
  return row.at_1_m_db + row.slope_db * std::log10(distance_m) +
         row.frequency_db * std::log10(carrier_GHz);
}

}  // namespace

IndoorFactory IndoorFactory::of(Clutter clutter, double carrier_GHz) {
  IndoorFactory hall;
  hall.clutter = clutter;
  hall.carrier_GHz = carrier_GHz;
  hall.station_height_m = hall.station_is_high() ? 8.0 : 1.5;
  const bool dense = clutter == Clutter::dense_low || clutter == Clutter::dense_high;
  hall.clutter_height_m = dense ? 6.0 : 2.0;
  hall.clutter_size_m = dense ? 2.0 : 10.0;
  hall.clutter_density = dense ? 0.6 : 0.2;
  return hall;
}

double IndoorFactory::los_probability(double distance_m) const {
  double k_m = -clutter_size_m / std::log1p(-clutter_density);
  if (station_is_high()) {
    k_m *= (station_height_m - vehicle_height_m) / (clutter_height_m - vehicle_height_m);
  }
  return std::exp(-distance_m / k_m);
}

double IndoorFactory::path_loss_db(double distance_m, bool line_of_sight) const {
  const double way_m =
      std::hypot(std::max(distance_m, kNearest_m), station_height_m - vehicle_height_m);
  const double seen_db = loss_db(kLineOfSight, way_m, carrier_GHz);
  if (line_of_sight) return seen_db;
  double hidden_db = std::max(seen_db, loss_db(without_sight(clutter), way_m, carrier_GHz));
  if (clutter == Clutter::dense_low) {
    hidden_db =
        std::max(hidden_db, loss_db(without_sight(Clutter::sparse_low), way_m, carrier_GHz));
  }
  return hidden_db;
}

double IndoorFactory::shadowing_sd_db(bool line_of_sight) const {
  return (line_of_sight ? kLineOfSight : without_sight(clutter)).shadowing_sd_db;
}

IndoorFactoryMap::IndoorFactoryMap(const IndoorFactory& hall, double station_x_m,
                                   double station_y_m, RandomEngine& random)
    : hall_(hall),
      x_m_(station_x_m),
      y_m_(station_y_m),
      sight_(1.0, hall.clutter_size_m / 2.0, random),
      shadow_(1.0, kShadowingDistance_m, random) {}

double IndoorFactoryMap::distance_m(double x_m, double y_m) const {
  return std::hypot(x_m - x_m_, y_m - y_m_);
}

bool IndoorFactoryMap::line_of_sight(double x_m, double y_m) const {
  const boost::math::normal normal;
  return boost::math::cdf(normal, sight_.at(x_m, y_m)) <
         hall_.los_probability(distance_m(x_m, y_m));
}

double IndoorFactoryMap::path_loss_db(double x_m, double y_m) const {
  const bool seen = line_of_sight(x_m, y_m);
  return hall_.path_loss_db(distance_m(x_m, y_m), seen) +
         hall_.shadowing_sd_db(seen) * shadow_.at(x_m, y_m);
}

}  // namespace tether
