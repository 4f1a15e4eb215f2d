#include "tools/runs/path_figure.hpp"

#include <fmt/format.h>

#include <string>

#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
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

plot_lines = "plot NaN with lines lw 3 lc rgb '#444444' title 'walls', \
  'trajectory.csv' every ::1 using 5:6 with lines lw 2 lc rgb '#1b9e4b' title 'planned', \
  'trajectory.csv' every ::1 using 2:3 with lines lw 2 lc rgb '#1f5fbf' title 'actual', \
  'trajectory.csv' every ::1::1 using 2:3 with points pt 7 ps 1.2 lc rgb '#1f5fbf' title 'start'"

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
  run_gnuplot(folder, "path.gp", variables(scenario, epsilon_m) + kScript);
}

}  // namespace tether
