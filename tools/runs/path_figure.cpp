#include "tools/runs/path_figure.hpp"

#include <fmt/format.h>

#include <string>

#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/surroundings.hpp"
#include "controller/tube/tube_settings.hpp"
#include "netem/channel/settings.hpp"
#include "netem/models/kinds.hpp"
#include "tools/base/gnuplot.hpp"

namespace tether {
namespace {

std::string channel_text(const char* name, const LinkConfig& link) {
  return fmt::format("{} {}", name, describe_model(link));
}

/// Figures are expected to come from ODE; only another plant is named in them.
std::string plant_text(const Scenario& scenario) {
  const bool is_ode = scenario.get<VehicleSettings>().plant == VehicleSettings::Plant::ode;
  return is_ode ? "" : fmt::format("{} plant; ", scenario.get<VehicleSettings>().plant_name());
}

std::string variables(const Scenario& scenario, double epsilon_m) {
  return fmt::format(
      "title_text = \"ε = {:.2f} m   ({}{}; {}; seed {})\"\n"
      "wall = {}\n",
      epsilon_m, plant_text(scenario), channel_text("up", scenario.get<ChannelSettings>().uplink),
      channel_text("down", scenario.get<ChannelSettings>().downlink),
      scenario.get<RunSettings>().seed, scenario.get<WorldSettings>().half_extent_m);
}

std::string polygon(const Shape& shape) {
  const auto at = corners(shape);
  std::string text = fmt::format("polygon from {:.3f},{:.3f}", at[3].x_m, at[3].y_m);
  for (const Position& p : at) text += fmt::format(" to {:.3f},{:.3f}", p.x_m, p.y_m);
  return text;
}

std::string object(std::size_t number, const Shape& shape, const char* style) {
  const bool round = shape.outline == Shape::Outline::circle;
  return fmt::format("set object {} {} {}\n", number,
                     round ? fmt::format("circle at {:.3f},{:.3f} size {:.3f}", shape.pose.x_m,
                                         shape.pose.y_m, shape.radius_m)
                           : polygon(shape),
                     style);
}

/// Standing obstacles, and the paths of moving ones.
std::string obstacles(const Scenario& scenario) {
  const auto& surroundings = scenario.get<Surroundings>();
  std::string text;
  std::size_t number = 1;  // 1 itself is the walls
  for (const Shape& shape : solid_shapes(surroundings)) {
    text += object(++number, shape, "fs solid 1.0 border lc rgb '#777777' fc rgb '#cccccc' behind");
  }
  MovingObstacles moving(surroundings, scenario.get<RunSettings>().seed);
  for (const Shape& shape : moving.at(0.0)) {
    text += object(++number, shape, "fs solid 1.0 noborder fc rgb '#e08a1e' front");
  }
  for (const Obstacle& obstacle : surroundings.obstacles) {
    Position from{obstacle.pose.x_m, obstacle.pose.y_m};
    for (const Position& to : obstacle.to) {
      text += fmt::format("set arrow from {},{} to {},{} nohead dt 3 lw 1.5 lc rgb '#e08a1e'\n",
                          from.x_m, from.y_m, to.x_m, to.y_m);
      from = to;
    }
  }
  return text;
}

constexpr char kOneVehicle[] = R"gnuplot(
band = tube > 0 ? "'trajectory.csv' every ::1 using 5:6:(tube) with circles fs solid noborder \
  lc rgb '#d3ecdb' title 'tube of plans', " : ''
vehicles = band . "'trajectory.csv' every ::1 using 5:6 with lines lw 4 lc rgb '#009e73' title 'planned', \
  'trajectory.csv' every ::1 using 2:3 with lines lw 2 lc rgb '#0072b2' title 'actual', \
  'trajectory.csv' every ::1::1 using 2:3 with points pt 7 ps 1.2 lc rgb '#000000' title 'start'"
)gnuplot";

constexpr char kVehicles[] = R"gnuplot(
set datafile separator ","
stats 'trajectories.csv' every ::1 using 2 nooutput
last = STATS_blocks - 1
vehicles = "for [i=0:last] 'trajectories.csv' index i every ::1 using 6:7 with lines lw 4 \
    lc rgb '#009e73' title (i == 0 ? 'planned' : ''), \
  for [i=0:last] 'trajectories.csv' index i every ::1 using 3:4 with lines lw 1.5 \
    lc rgb '#0072b2' title (i == 0 ? 'actual' : ''), \
  for [i=0:last] 'trajectories.csv' index i every ::1::1 using 3:4 with points pt 7 ps 0.9 \
    lc rgb '#000000' title (i == 0 ? 'start' : '')"
)gnuplot";

constexpr char kScript[] = R"gnuplot(
set datafile separator ","
set title title_text font ",11"
set xlabel "x [m]"
set ylabel "y [m]"
set size ratio -1
set xrange [-1.08 * wall : 1.08 * wall]
set yrange [-1.08 * wall : 1.08 * wall]
set grid lc rgb "#dddddd"
set key outside bottom center horizontal
set object 1 rectangle from -wall,-wall to wall,wall fs empty border lc rgb "#444444" lw 3

plot_lines = "plot NaN with lines lw 3 lc rgb '#444444' title 'walls', " . vehicles

set terminal svg size 720,760 font "Helvetica,12" background "white"
set output "path.svg"
eval plot_lines
set terminal pngcairo size 900,950 font "Helvetica,12"
set output "path.png"
eval plot_lines
set output
)gnuplot";

}  // namespace

void draw_path_figure(const std::filesystem::path& folder, const Scenario& scenario,
                      double epsilon_m) {
  run_gnuplot(folder, "path.gp",
              variables(scenario, epsilon_m) +
                  fmt::format("tube = {}\n", tube_m(scenario).value_or(0.0)) + obstacles(scenario) +
                  kOneVehicle + kScript);
}

void draw_fleet_figure(const std::filesystem::path& folder, const Scenario& scenario,
                       double epsilon_m) {
  run_gnuplot(folder, "path.gp",
              variables(scenario, epsilon_m) + obstacles(scenario) + kVehicles + kScript);
}

}  // namespace tether
