#include "tools/experiment/statistics/pareto.hpp"

#include <fmt/format.h>

#include <array>
#include <stdexcept>

#include "tools/experiment/figures/figure_script.hpp"
#include "tools/experiment/figures/figures.hpp"

namespace tether {
namespace {

constexpr char kParetoCommands[] = R"gnuplot(
  set xlabel x_label noenhanced offset 0,0.4
  set ylabel y_label noenhanced offset 1.2,0
  set logscale xy
  set format "%g"
  set grid xtics ytics lc rgb "#e4e4e4" lw 0.5
  set xrange [x_low:x_high]
  set yrange [y_low:y_high]
  set lmargin at screen 1.3 / width_cm
  set rmargin at screen 1 - 0.3 / width_cm
  set tmargin at screen 1 - top_cm / height_cm
  set bmargin at screen (bottom_cm + 1.0) / height_cm
  command = "plot data every ::1 using ($1 == 0 ? $2 : NaN):5 with steps lw 1 dt (6,3) lc rgb '#444444'"
  do for [s = 1 : series] {
    rows = sprintf("($1 == %d ? $2 : NaN)", s)
    command = command . sprintf(", data every ::1 using %s:5:3:4:6:7 with xyerrorbars pt 7 ps 0.5 " \
      . "lw 1 lc rgb '#%s'", rows, word(colours, s))
  }
  eval command
)gnuplot";

bool is_drawn(const PlottedPoint& p) {
  return std::isfinite(p.x) && std::isfinite(p.mean) && p.x > 0.0 && p.mean > 0.0;
}

/// Without an interval, its point alone.
Interval bar(const Interval& interval, double value) {
  return std::isfinite(half_width(interval)) && interval.low > 0.0 ? interval
                                                                   : Interval{value, value};
}

std::string row(std::size_t series, const PlottedPoint& p, const std::string& name) {
  const Interval x = bar(p.x_interval, p.x), y = bar(p.interval, p.mean);
  return fmt::format("{},{},{},{},{},{},{},{},{},{}\n", series, p.x, x.low, x.high, p.mean, y.low,
                     y.high, p.succeeded(), p.lost, csv_cell(name));
}

}  // namespace

void draw_pareto(const std::filesystem::path& folder, const std::string& stem,
                 const ParetoFigure& figure) {
  using Sample = LegendEntry::Sample;
  std::vector<const PlottedPoint*> drawn;
  std::vector<Tradeoff> trades;
  std::vector<LegendEntry> legend;
  std::string csv = "series,x,x_low,x_high,mean,low,high,n,lost,name\n", colours;
  LeastMost x, y;
  std::size_t least = static_cast<std::size_t>(-1), most = 0, failed = 0;
  for (std::size_t s = 0; s < figure.series.size() && s < kSeriesColours.size(); ++s) {
    colours += fmt::format("{} ", kSeriesColours[s]);
    legend.push_back({Sample::point, fmt::format("ps 0.5 lc rgb \"#{}\"", kSeriesColours[s]),
                      figure.series[s].name});
    for (const PlottedPoint& p : figure.series[s].points) {
      const std::size_t n = p.succeeded();
      least = std::min(least, n);
      most = std::max(most, n);
      failed += p.runs.size() - n;
      if (!is_drawn(p)) continue;
      drawn.push_back(&p);
      trades.push_back({p.x, p.mean});
      for (const double value : {p.x, bar(p.x_interval, p.x).low, bar(p.x_interval, p.x).high}) {
        x.add(value);
      }
      for (const double value :
           {p.mean, bar(p.interval, p.mean).low, bar(p.interval, p.mean).high}) {
        y.add(value);
      }
      csv += row(s + 1, p, figure.series[s].name);
    }
  }
  if (drawn.empty() || figure.series.size() > kSeriesColours.size()) {
    throw std::invalid_argument("a Pareto figure needs a point and at most 7 series");
  }
  for (const std::size_t i : pareto_front(trades)) csv += row(0, *drawn[i], "front");
  legend.push_back({Sample::line, "lw 1 dt (6,3) lc rgb \"#444444\"", "front"});
  const FigureFrame frame(
      figure.text,
      seeds_note(least, most, failed) +
          fmt::format("; means with {:g} % intervals", 100.0 * figure.confidence) +
          losses_note(figure.series),
      legend, FigureFrame::Legend::above);
  std::string variables = frame.variables(stem, figure.text.height_cm);
  variables += fmt::format(
      "x_low = {}\nx_high = {}\ny_low = {}\ny_high = {}\nx_label = {}\ny_label = {}\n"
      "series = {}\ncolours = \"{}\"\n",
      0.8 * x.low, 1.25 * x.high, 0.8 * y.low, 1.25 * y.high, gnuplot_text(figure.x_label),
      gnuplot_text(figure.y_label), figure.series.size(), colours);
  draw_figure(folder, stem, csv, figure.text, variables, kParetoCommands);
}

}  // namespace tether
