#pragma once

#include <string>
#include <vector>

#include "common/path/reference_path.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/processes/recent_link.hpp"
#include "tools/runs/run_observer.hpp"

namespace tether {

/// How a live run is going, for a terminal; of a fleet as a whole, and of its first vehicle. Pure.
class Dashboard {
 public:
  static constexpr int kColumns = 79, kRows = 17;

  /// Values that an observer of the run does not have.
  struct Moment {
    double t_s = 0.0;
    RecentLink::Seen uplink, downlink;  ///< in the last seconds
    std::vector<std::string> fleet;     ///< fleet_now()
    std::vector<Position> others;       ///< where the fleet's other vehicles are
    std::string drives;                 ///< state of the drives on CAN; empty: there are none
    std::vector<std::string> findings;  ///< reasons why the run is invalid
    std::vector<std::string> silent;    ///< silent programs, and for how long
  };

  /// `scenario`: the first vehicle's.
  explicit Dashboard(const Scenario& scenario);

  /// In one line of fewer than 80 columns, but for what is wrong: the time that is left, where the
  /// vehicle is, its error now, reception ratio and mean delay of the last seconds each way, the
  /// drives; of a fleet the time and how it stands.
  std::string line(const RunObserver& run, const Moment& moment) const;
  /// All beside a map: the path faint, the way of the last 20 s, the vehicle as an arrow, the
  /// fleet's others as dots. At most kRows lines of at most kColumns columns.
  std::vector<std::string> lines(const RunObserver& run, const Moment& moment) const;

 private:
  double left_s(const Moment& moment) const;
  std::string map_title() const;
  std::vector<std::string> map(const RunObserver& run, const Moment& moment) const;
  std::vector<std::string> facts(const RunObserver& run, const Moment& moment) const;

  std::string name_;
  double duration_s_;
  double half_extent_m_;  ///< half extent of the map
  std::vector<Position> path_;
};

}  // namespace tether
