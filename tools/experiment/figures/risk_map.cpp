#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "tools/experiment/figures/figure_script.hpp"
#include "tools/experiment/figures/figures.hpp"

namespace tether {
namespace {

constexpr int kArrows = 8;
// Turns of planned paths: of shorter steps and lesser bends, rounding would make turns.
constexpr double kShortest_m = 0.03, kStraight_radpm = 5e-3;

constexpr char kRiskMapCommands[] = R"gnuplot(
  set multiplot
  # The map, from the top; square.
  set lmargin at screen left_cm / width_cm
  set rmargin at screen (left_cm + side_cm) / width_cm
  set tmargin at screen (map_cm + side_cm) / height_cm
  set bmargin at screen map_cm / height_cm
  set size ratio -1
  set xrange [-1.06 * wall : 1.06 * wall]
  set yrange [-1.06 * wall : 1.06 * wall]
  set xlabel "x [m]" offset 0,0.5
  set ylabel "y [m]" offset 1.2,0
  set object 1 rectangle from -wall,-wall to wall,wall fs empty border lc rgb "#444444" lw 1.5
  set cbrange [colour_low:colour_high]
  set cblabel value_label noenhanced offset 0.3,0
  set colorbox user noborder origin screen (left_cm + side_cm + 0.25) / width_cm, \
    screen map_cm / height_cm size screen 0.28 / width_cm, screen side_cm / height_cm
  eval arrows
  plot data every ::1 using ($8 == 1 ? $2 : NaN):3 with lines lw 9 lc rgb "#dddddd", \
    data every ::1 using 2:3 with lines lw 4.6 lc rgb "#666666", \
    data every ::1 using 2:($4 == $4 ? $3 : NaN):4 with lines lw 3.6 lc palette, \
    data every ::1::1 using 2:3 with points pt 7 ps 1.1 lc rgb "#ffffff", \
    data every ::1::1 using 2:3 with points pt 6 ps 1.1 lw 1.6 lc rgb "#000000", \
    data every ::1::1 using (start_x):(start_y):("start") with labels font ",7"
  unset label
  unset arrow
  unset object

  # Risk against time.
  set tmargin at screen (time_cm + time_height_cm) / height_cm
  set bmargin at screen time_cm / height_cm
  set rmargin at screen 1 - right_cm / width_cm
  set size noratio
  set xrange [time_low:time_high]
  set yrange [0:y_high]
  set xlabel "time on the path [s]" offset 0,0.5
  set ylabel value_label noenhanced offset 1.2,0
  set grid y lc rgb "#e4e4e4" lw 0.5
  eval turns
  command = "plot data every ::1 using 1:5:6 with filledcurves fs solid noborder " \
    . "fc rgb '#990072b2'" \
    . ", data every ::1 using 1:4 with lines lw 1.5 lc rgb '#0072b2'"
  if (alone) {
    command = command . ", data every ::1 using 1:4:5:6 with yerrorbars pt 7 ps 0.45 " \
      . "lc rgb '#0072b2'"
  }
  if (n_low < n_high) {
    set y2range [0 : 1.1 * n_high]
    set y2tics
    command = command . ", data every ::1 using 1:7 axes x1y2 with steps lw 1 dt (4,3) " \
      . "lc rgb '#444444'"
  }
  eval command
  unset y2tics
  unset grid
  unset multiplot
)gnuplot";

bool within(const std::vector<TimeSpan>& spans, double time_s) {
  return std::any_of(spans.begin(), spans.end(), [time_s](const TimeSpan& span) {
    return span.start_s <= time_s && time_s <= span.end_s;
  });
}

double distance_m(const RiskPoint& a, const RiskPoint& b) {
  return std::hypot(b.x_m - a.x_m, b.y_m - a.y_m);
}

// Arrow heads at even distances along the path.
std::string arrows(const std::vector<RiskPoint>& path) {
  double length_m = 0.0, done_m = 0.0;
  for (std::size_t i = 1; i < path.size(); ++i) length_m += distance_m(path[i - 1], path[i]);
  std::string commands;
  int drawn = 0;
  for (std::size_t i = 1; i < path.size() && drawn < kArrows; ++i) {
    const RiskPoint &from = path[i - 1], &to = path[i];
    const double step_m = distance_m(from, to);
    done_m += step_m;
    if (!(step_m > 0.0) || done_m < (drawn + 0.6) * length_m / kArrows) continue;
    ++drawn;
    const double reach_m = 0.002 * length_m / step_m;
    const std::string way =
        fmt::format("from {:.4f},{:.4f} to {:.4f},{:.4f}", from.x_m, from.y_m,
                    to.x_m + reach_m * (to.x_m - from.x_m), to.y_m + reach_m * (to.y_m - from.y_m));
    for (const char* look : {"0.025,27,90 fixed lw 1 lc rgb \"#ffffff\"",
                             "0.023,22,90 fixed lw 0.5 lc rgb \"#000000\""}) {
      commands += fmt::format("set arrow {} front head filled size screen {}; ", way, look);
    }
  }
  return "arrows = " + gnuplot_text(commands) + "\n";
}

std::string turn_shades(const std::vector<TimeSpan>& turns) {
  std::string commands;
  for (const TimeSpan& turn : turns) {
    commands += fmt::format(
        "set object rectangle from {},graph 0 to {},graph 1 behind fs solid noborder fc rgb "
        "\"#dddddd\"; ",
        turn.start_s, turn.end_s);
  }
  return "turns = " + gnuplot_text(commands) + "\n";
}

std::string ranges(const std::vector<RiskPoint>& points) {
  LeastMost mean, top, time, n;
  for (const RiskPoint& p : points) {
    time.add(p.time_s);
    n.add(static_cast<double>(p.n));
    for (const double value : {p.mean, p.interval.low, p.interval.high}) top.add(value);
    mean.add(p.mean);
  }
  if (mean.empty()) mean = top = {0.0, 1.0};
  if (!(mean.low < mean.high)) {
    const double margin = mean.low == 0.0 ? 1.0 : 0.1 * std::abs(mean.low);
    mean = {mean.low - margin, mean.high + margin};
  }
  const double margin_s = time.low < time.high ? 0.0 : 1.0;
  return fmt::format(
      "colour_low = {}\ncolour_high = {}\ny_high = {}\ntime_low = {}\ntime_high = {}\n"
      "n_low = {}\nn_high = {}\n",
      mean.low, mean.high, top.high > 0.0 ? 1.08 * top.high : 1.0, time.low - margin_s,
      time.high + margin_s, n.low, n.high);
}

std::string csv_of(const RiskMapFigure& figure) {
  std::string csv = "time_s,x_m,y_m,mean,low,high,n,turn\n";
  for (const RiskPoint& p : figure.points) {
    csv += fmt::format("{},{},{},{},{},{},{},{}\n", p.time_s, p.x_m, p.y_m, p.mean, p.interval.low,
                       p.interval.high, p.n, within(figure.turns, p.time_s) ? 1 : 0);
  }
  return csv;
}

std::string note_of(const RiskMapFigure& figure) {
  std::size_t least = figure.points.front().n, most = least;
  for (const RiskPoint& p : figure.points) {
    least = std::min(least, p.n);
    most = std::max(most, p.n);
  }
  return seeds_note(least, most, figure.failed) + (figure.note.empty() ? "" : "; " + figure.note);
}

std::vector<LegendEntry> legend_of(const RiskMapFigure& figure) {
  using Sample = LegendEntry::Sample;
  std::vector<LegendEntry> entries{{Sample::line, "lw 1.5 lc rgb \"#0072b2\"", "mean"}};
  const auto has_interval = [](const RiskPoint& p) {
    return std::isfinite(half_width(p.interval));
  };
  if (std::any_of(figure.points.begin(), figure.points.end(), has_interval)) {
    entries.push_back({Sample::area, "fs solid noborder fc rgb \"#990072b2\"",
                       fmt::format("its {:g} % interval", 100.0 * figure.confidence)});
  }
  if (!figure.turns.empty()) {
    entries.push_back({Sample::area, "fs solid noborder fc rgb \"#dddddd\"", "turn"});
  }
  const auto differs = [&](const RiskPoint& p) { return p.n != figure.points.front().n; };
  if (std::any_of(figure.points.begin(), figure.points.end(), differs)) {
    entries.push_back({Sample::line, "lw 1 dt (4,3) lc rgb \"#444444\"", "n (right)"});
  }
  return entries;
}

// Where the word "start" is farthest from the path, counted in its own width and height.
PointInPlane start_label(const RiskMapFigure& figure) {
  const double half_width_m = 0.2 * figure.half_extent_m,
               half_height_m = 0.07 * figure.half_extent_m;
  const RiskPoint& start = figure.points.front();
  PointInPlane best;
  double farthest = -1.0;
  for (int i = 0; i < 16; ++i) {
    const double angle = std::numbers::pi / 8.0 * i;
    const PointInPlane label{start.x_m + 1.4 * half_width_m * std::cos(angle),
                             start.y_m + 1.8 * half_height_m * std::sin(angle)};
    double nearest = std::numeric_limits<double>::infinity();
    for (const RiskPoint& p : figure.points) {
      nearest = std::min(nearest, std::max(std::abs(p.x_m - label.x_m) / half_width_m,
                                           std::abs(p.y_m - label.y_m) / half_height_m));
    }
    if (nearest > farthest) {
      farthest = nearest;
      best = label;
    }
  }
  return best;
}

}  // namespace

std::vector<TimeSpan> sharp_turns(const std::vector<RiskPoint>& path) {
  std::vector<double> bend(path.size(), 0.0);  // rad/m
  for (std::size_t i = 1; i + 1 < path.size(); ++i) {
    const RiskPoint &a = path[i - 1], &b = path[i], &c = path[i + 1];
    const double ux = b.x_m - a.x_m, uy = b.y_m - a.y_m, vx = c.x_m - b.x_m, vy = c.y_m - b.y_m;
    const double length_m = 0.5 * (std::hypot(ux, uy) + std::hypot(vx, vy));
    // Where a path rests, the rounding of stored points would be its sharpest bends.
    if (length_m > kShortest_m) {
      bend[i] = std::abs(std::atan2(ux * vy - uy * vx, ux * vx + uy * vy)) / length_m;
    }
  }
  std::vector<TimeSpan> turns;
  if (path.size() < 3) return turns;
  const double sharpest = *std::max_element(bend.begin(), bend.end());
  const double least = *std::min_element(bend.begin() + 1, bend.end() - 1);
  if (least > 0.5 * sharpest || sharpest < kStraight_radpm) return turns;
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (bend[i] <= 0.5 * sharpest) continue;
    if (bend[i - 1] <= 0.5 * sharpest) turns.push_back({path[i].time_s, path[i].time_s});
    turns.back().end_s = path[i].time_s;
  }
  return turns;
}

void draw_risk_map(const std::filesystem::path& folder, const std::string& stem,
                   const RiskMapFigure& figure) {
  if (figure.points.empty() || !(figure.half_extent_m > 0.0)) {
    throw std::invalid_argument("a risk map needs a point and walls");
  }
  const double width_cm = figure.text.width_cm;
  const FigureFrame frame(figure.text, note_of(figure), legend_of(figure),
                          FigureFrame::Legend::below);
  const double left_cm = 1.3, side_cm = width_cm - left_cm - 1.9, time_height_cm = 2.6;
  const double time_cm = frame.bottom_cm() + 1.05, map_cm = time_cm + time_height_cm + 1.15;
  const double height_cm = map_cm + side_cm + frame.top_cm();
  std::string variables = frame.variables(stem, height_cm);
  variables += ranges(figure.points) + arrows(figure.points) + turn_shades(figure.turns);
  const PointInPlane start = start_label(figure);
  variables += fmt::format(
      "wall = {}\nvalue_label = {}\nleft_cm = {}\nside_cm = {:.3f}\nmap_cm = {:.3f}\n"
      "time_cm = {:.3f}\ntime_height_cm = {}\nright_cm = 0.8\nstart_x = {:.2f}\n"
      "start_y = {:.2f}\nalone = {}\n",
      figure.half_extent_m, gnuplot_text(figure.value_label), left_cm, side_cm, map_cm, time_cm,
      time_height_cm, start.x_m, start.y_m, figure.points.size() == 1 ? 1 : 0);
  draw_figure(folder, stem, csv_of(figure), figure.text, variables, kRiskMapCommands);
}

}  // namespace tether
