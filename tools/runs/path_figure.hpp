#pragma once

#include <filesystem>

#include "common/scenario/scenario.hpp"

namespace tether {

/// Draws `folder`/trajectory.csv with gnuplot to path.svg and path.png: planned path green, actual
/// path blue, walls, obstacles grey, what moves orange (its place at the start, its way dotted),
/// equal axes, ε in the title, and the plant if it is not ODE. With tube.silence_s,
/// the tube of plans is a band around the planned path (not of a fleet). The script stays beside
/// them as path.gp, to be restyled and run again. Throws if gnuplot is missing (naming the package)
/// or fails.
void draw_path_figure(const std::filesystem::path& folder, const Scenario& scenario,
                      double epsilon_m);

/// The same of `folder`/trajectories.csv, for a fleet; ε is the mean of its vehicles.
void draw_fleet_figure(const std::filesystem::path& folder, const Scenario& scenario,
                       double epsilon_m);

}  // namespace tether
