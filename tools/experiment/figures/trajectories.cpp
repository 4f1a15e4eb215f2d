#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

#include "tools/experiment/figures/figure_script.hpp"
#include "tools/experiment/figures/figures.hpp"

namespace tether {
namespace {

// Everything is placed in cm: square panels, tics only at the outer ones.
constexpr double kLeft_cm = 1.15, kRight_cm = 0.15, kGap_cm = 0.2, kPanelTitle_cm = 0.62;

constexpr char kTrajectoriesCommands[] = R"gnuplot(
  set multiplot
  set size ratio -1
  set xrange [-1.06 * wall : 1.06 * wall]
  set yrange [-1.06 * wall : 1.06 * wall]
  set xtics tic_step; set ytics tic_step
  set grid lc rgb "#e4e4e4" lw 0.5
  set object 1 rectangle from -wall,-wall to wall,wall fs empty border lc rgb "#444444" lw 1.5
  rows = int(ceil(1.0 * |titles| / columns))
  do for [i = 0 : |titles| - 1] {
    column = i % columns
    row = i / columns
    left = left_cm + column * (side_cm + gap_cm)
    top = height_cm - top_cm - row * (side_cm + panel_title_cm) - panel_title_cm
    set lmargin at screen left / width_cm
    set rmargin at screen (left + side_cm) / width_cm
    set tmargin at screen top / height_cm
    set bmargin at screen (top - side_cm) / height_cm
    set title titles[i + 1] noenhanced offset 0,-0.7
    if (column == 0) { set ylabel "y [m]" offset 1.2,0; set format y "%g" } \
    else { unset ylabel; set format y "" }
    if (i + columns >= |titles|) { set xlabel "x [m]" offset 0,0.5; set format x "%g"; set xtics scale 0.6 } \
    else { unset xlabel; set format x ""; set xtics scale 0 }
    plot data every ::1 using ($1 == i + 1 && strcol(2) eq "planned" ? $3 : NaN):4 \
        with lines lw 2 lc rgb "#009e73", \
      '' every ::1 using ($1 == i + 1 && strcol(2) eq "actual" ? $3 : NaN):4 \
        with lines lw 1 lc rgb "#0072b2", \
      '' every ::1 using ($1 == i + 1 && strcol(2) eq "start" ? $3 : NaN):4 \
        with points pt 7 ps 0.5 lc rgb "#000000"
    unset label
    unset arrow
  }
  unset multiplot
)gnuplot";

bool finite(const PointInPlane& p) { return std::isfinite(p.x_m) && std::isfinite(p.y_m); }

// Points nearer to the last than what a print can show are left out.
std::string path_rows(std::size_t panel, const char* name, const std::vector<PointInPlane>& path,
                      double nearest_m) {
  std::string rows;
  const PointInPlane* last = nullptr;
  for (const PointInPlane& p : path) {
    const bool is_end = &p == &path.back();
    if (!finite(p)) continue;
    if (last && !is_end && std::hypot(p.x_m - last->x_m, p.y_m - last->y_m) < nearest_m) continue;
    rows += fmt::format("{},{},{},{}\n", panel, name, p.x_m, p.y_m);
    last = &p;
  }
  return rows;
}

std::string csv_of(const TrajectoryFigure& figure) {
  std::string csv = "panel,path,x_m,y_m\n";
  const double nearest_m = figure.half_extent_m / 1000.0;
  for (std::size_t i = 0; i < figure.panels.size(); ++i) {
    const TrajectoryPanel& panel = figure.panels[i];
    csv += path_rows(i + 1, "planned", panel.planned, nearest_m);
    csv += path_rows(i + 1, "actual", panel.actual, nearest_m);
    if (!panel.actual.empty()) csv += path_rows(i + 1, "start", {panel.actual.front()}, 0.0);
  }
  return csv;
}

}  // namespace

void draw_trajectories(const std::filesystem::path& folder, const std::string& stem,
                       const TrajectoryFigure& figure) {
  const std::size_t count = figure.panels.size();
  if (count < 1 || count > 6 || !(figure.half_extent_m > 0.0)) {
    throw std::invalid_argument("trajectories need 1 to 6 panels and walls");
  }
  const std::size_t columns = std::min<std::size_t>(count, figure.text.width_cm < 12.0 ? 2 : 3);
  const std::size_t rows = (count + columns - 1) / columns;
  const auto across = static_cast<double>(columns), down = static_cast<double>(rows);
  const double side_cm =
      (figure.text.width_cm - kLeft_cm - kRight_cm - kGap_cm * (across - 1.0)) / across;
  using Sample = LegendEntry::Sample;
  const FigureFrame frame(figure.text, figure.note,
                          {{Sample::line, "lw 2 lc rgb \"#009e73\"", "planned"},
                           {Sample::line, "lw 1 lc rgb \"#0072b2\"", "actual"},
                           {Sample::point, "ps 0.5 lc rgb \"#000000\"", "start"},
                           {Sample::line, "lw 1.5 lc rgb \"#444444\"", "walls"}},
                          FigureFrame::Legend::below);
  const double height_cm =
      frame.top_cm() + down * (side_cm + kPanelTitle_cm) + 1.0 + frame.bottom_cm();
  // A step of 2, 5 or 10 times a power of ten, at least so wide that labels do not touch.
  const double raw = 2.12 * figure.half_extent_m * 0.75 / side_cm,
               power = std::pow(10.0, std::floor(std::log10(raw)));
  const double step = power * (raw / power > 5.0 ? 10.0 : raw / power > 2.0 ? 5.0 : 2.0);

  std::string variables = frame.variables(stem, height_cm);
  variables += fmt::format(
      "wall = {}\ntic_step = {}\ncolumns = {}\nside_cm = {:.3f}\nleft_cm = {}\ngap_cm = {}\n"
      "panel_title_cm = {}\narray titles[{}]\n",
      figure.half_extent_m, step, columns, side_cm, kLeft_cm, kGap_cm, kPanelTitle_cm, count);
  for (std::size_t i = 0; i < count; ++i) {
    variables += fmt::format("titles[{}] = {}\n", i + 1, gnuplot_text(figure.panels[i].title));
  }
  draw_figure(folder, stem, csv_of(figure), figure.text, variables, kTrajectoriesCommands);
}

}  // namespace tether
