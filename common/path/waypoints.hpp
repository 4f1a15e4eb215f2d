#pragma once

#include <istream>
#include <optional>
#include <string>
#include <vector>

namespace tether {

struct Waypoint {
  double x_m = 0.0;
  double y_m = 0.0;
  std::optional<double> v_mps;  ///< speed that is wanted there
  int line = 0;                 ///< line in the file
};

/// Points to pass through, in order.
///
/// CSV with a header line: x_m, y_m (within ±1e5 m) and, if wanted, v_mps (0.01 to 100; at the
/// first and last point 0 is allowed, too). Other columns are ignored. The path is closed if the
/// last point is the first one (within 1 µm).
struct Waypoints {
  std::string file;  ///< for messages
  std::vector<Waypoint> points;

  bool is_closed() const;
};

/// Throws UsageError "name:line: …" for other files, for fewer than 2 points (4 if closed), more
/// than 100 000, and for neighbours less than 1 mm apart. Turns of more than 135° from one chord to
/// the next are refused, too, because no wheels can follow them.
Waypoints read_waypoints(std::istream& in, const std::string& name);

/// The same from a file.
Waypoints load_waypoints(const std::string& file);

}  // namespace tether
