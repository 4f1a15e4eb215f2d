#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include "common/scenario/scenario.hpp"

namespace tether {

/// Where a scenario's loop is mean-square stable, by PRR each way (independent losses in place of
/// the channel's) and delay from pose to wheels, and what runs have at some of these places.
struct StabilityMap {
  struct Edge {
    double delay_s, prr;  ///< stable from this PRR on
  };
  struct Point {
    double prr, delay_s, error_m;  ///< settled_error()
  };
  std::vector<Edge> edges;  ///< edges of ascending delays, as far as PRR 1 is stable
  double longest_s = 0.0;   ///< longest considered delay
  double limit_m = 0.0;     ///< runs with a smaller error count as stable
  std::size_t seeds = 0;    ///< number per point
  std::vector<Point> points;
};

/// Runs are on the scenario's own path, with its noise; delays are the uplink's. Throws UsageError
/// for margin_obstacles(), and if the links are not `fixed`.
StabilityMap stability_map(const Scenario& scenario, double limit_m, std::size_t seeds,
                           std::size_t jobs);

/// Throws for scenarios that stability_map() refuses: before anything is computed for it.
void check_map(const Scenario& scenario);
/// Throws UsageError unless it is *.png or *.svg.
void check_map_file(const std::filesystem::path& file);

/// Draws it with gnuplot into `file`, *.png or *.svg; script and data stay beside it. Throws
/// as check_map_file() and run_gnuplot() do.
void draw_stability_map(const std::filesystem::path& file, const Scenario& scenario,
                        const StabilityMap& map);

}  // namespace tether
