#pragma once

#include <vector>

#include "common/onboard/scan.hpp"
#include "localiser/odometry/odometry_track.hpp"

namespace tether {

/// A beam that hit something, in the vehicle's frame at one time: x forward, y left.
struct Beam {
  float x_m = 0.0F, y_m = 0.0F;          ///< position of the end
  float along_x = 1.0F, along_y = 0.0F;  ///< its direction, of length 1
  float share = 0.0F;                    ///< share of the scan's time at which it was measured
};

/// The beams of a scan that hit something within its range, at most `most` of its angles, evenly
/// chosen, as they would have been measured all at `when`. Each was measured from where the vehicle
/// was at its time by `odometry` (which may be empty: it stood); so a moving vehicle does not
/// distort the scan. What the wheels get wrong meanwhile matters least in the scan's middle().
std::vector<Beam> beams_of(const Scan& scan, const OdometryTrack& odometry, Instant when,
                           std::size_t most);

inline Instant middle(const Scan& scan) { return scan.stamp + (scan.end() - scan.stamp) / 2; }

}  // namespace tether
