#include <fmt/format.h>

#include <array>
#include <cmath>
#include <stdexcept>

#include "tools/experiment/figures/figure_script.hpp"
#include "tools/experiment/figures/figures.hpp"

namespace tether {
namespace {

constexpr char kCurveCommands[] = R"gnuplot(
  set xlabel x_label noenhanced offset 0,0.4 norotate
  set ylabel y_label noenhanced offset 1,0
  set grid y lc rgb "#e4e4e4" lw 0.5
  set xrange [x_low:x_high]
  set yrange [y_low:y_high]
  if (log_y) { set logscale y }
  set lmargin at screen 1.3 / width_cm
  set rmargin at screen 1 - 0.2 / width_cm
  set tmargin at screen 1 - top_cm / height_cm
  set bmargin at screen (bottom_cm + x_axis_cm) / height_cm
  eval name_tics
  command = "plot NaN"
  do for [s = 1 : series] {
    colour = word(colours, s)
    rows = sprintf("$1 == %d && strcol(2) eq", s)
    if (!named) {
      command = command . sprintf(", data every ::1 using (%s 'mean' ? $4 : NaN):6:7 " \
        . "with filledcurves fs solid noborder fc rgb '#b0%s'", rows, colour)
    }
    command = command . sprintf(", data every ::1 using (%s 'run' ? $4 : NaN):5 " \
      . "with points pt 7 ps 0.28 lc rgb '#70%s'", rows, colour)
    if (bars) {
      command = command . sprintf(", data every ::1 using (%s 'mean' ? $4 : NaN):5:6:7 " \
        . "with yerrorbars pt 0 lw %s lc rgb '#%s'", rows, named ? "2" : "1", colour)
    }
    command = command . sprintf(", data every ::1 using (%s 'mean' ? $4 : NaN):5 " \
      . "with %s pt 7 ps 0.45 lw 1.5 lc rgb '#%s'", rows, named ? "points" : "linespoints", colour)
    if (losses) {
      command = command . sprintf(", data every ::1 using (%s 'mean' && $9 > 0 ? $4 : NaN):5 " \
        . "with points pt 2 ps 0.6 lw 1 lc rgb '#000000'", rows)
    }
  }
  eval command
)gnuplot";

// Range of the axes, and spread of runs around their point.
struct Extent {
  LeastMost x, y;
  double least_positive = std::numeric_limits<double>::infinity();
  double nearest_x = std::numeric_limits<double>::infinity();
  std::size_t least = static_cast<std::size_t>(-1), most = 0, failed = 0;
  bool intervals = false, lonely_interval = false;

  void add_y(double value) {
    if (!std::isfinite(value)) return;
    y.add(value);
    if (value > 0.0) least_positive = std::min(least_positive, value);
  }

  double jitter() const {
    if (std::isfinite(nearest_x)) return 0.5 * nearest_x;
    return x.empty() ? 0.0 : std::max(0.02, 0.02 * std::abs(x.low));
  }
};

bool has_interval(const PlottedPoint& p) { return std::isfinite(half_width(p.interval)); }

Extent extent_of(const CurveFigure& figure) {
  Extent e;
  for (const CurveSeries& series : figure.series) {
    for (std::size_t i = 0; i < series.points.size(); ++i) {
      const PlottedPoint& p = series.points[i];
      e.x.add(p.x);
      if (i > 0) e.nearest_x = std::min(e.nearest_x, std::abs(p.x - series.points[i - 1].x));
      e.add_y(p.mean);
      e.add_y(p.interval.low);
      e.add_y(p.interval.high);
      for (const double run : p.runs) e.add_y(run);
      const std::size_t n = p.succeeded();
      e.least = std::min(e.least, n);
      e.most = std::max(e.most, n);
      e.failed += p.runs.size() - n;
      const bool before = i > 0 && has_interval(series.points[i - 1]);
      const bool after = i + 1 < series.points.size() && has_interval(series.points[i + 1]);
      e.intervals = e.intervals || has_interval(p);
      e.lonely_interval = e.lonely_interval || (has_interval(p) && !before && !after);
    }
  }
  return e;
}

/// True if the results do not vary, as without randomness: side by side their dots would look like
/// an error bar.
bool all_equal(const PlottedPoint& p) {
  LeastMost runs;
  for (const double run : p.runs) runs.add(run);
  return runs.high - runs.low <= 1e-9 * std::abs(runs.high);
}

// Means come first, and without gaps, so that lines and bands hold together.
std::string csv_of(const CurveFigure& figure, double jitter) {
  const bool has_names = !figure.names.empty();
  const auto x_name = [&](double x) {
    if (!has_names) return std::string();
    return "," + csv_cell(figure.names.at(static_cast<std::size_t>(std::lround(x)) - 1));
  };
  std::string csv = "series,kind,x,x_drawn,value,low,high,n,lost,name";
  csv += has_names ? ",x_name\n" : "\n";
  const double apart = has_names ? 1.0 : 0.0;  // distance between the series' means
  const auto count = static_cast<double>(figure.series.size());
  for (std::size_t s = 0; s < figure.series.size(); ++s) {
    const std::string name = csv_cell(figure.series[s].name);
    const double width = jitter / count;
    const double shift = (static_cast<double>(s) - 0.5 * (count - 1.0)) * width;
    std::string runs;
    for (const PlottedPoint& p : figure.series[s].points) {
      std::size_t n = 0;
      const double spread = all_equal(p) ? 0.0 : 1.0;
      for (const double run : p.runs) {
        if (!std::isfinite(run)) continue;
        // The golden ratio's multiples spread evenly, whatever their number.
        const double turn = std::fmod(0.6180339887498949 * static_cast<double>(++n), 1.0);
        runs += fmt::format(
            "{},run,{},{:.6g},{},,,,,{}{}\n", s + 1, p.x,
            p.x + (spread + apart > 0.0 ? shift : 0.0) + spread * 0.8 * width * (turn - 0.5), run,
            name, x_name(p.x));
      }
      csv += fmt::format("{},mean,{},{},{},{},{},{},{},{}{}\n", s + 1, p.x, p.x + apart * shift,
                         p.mean, p.interval.low, p.interval.high, n, p.lost, name, x_name(p.x));
    }
    csv += runs;
  }
  return csv;
}

std::string axes(const CurveFigure& figure, const Extent& e) {
  const bool log_y = figure.log_y && std::isfinite(e.least_positive);
  const double x_margin = 0.6 * e.jitter() + 0.02 * (e.x.high - e.x.low);
  double low = 0.0, high = e.y.empty() || e.y.high <= 0.0 ? 1.0 : 1.05 * e.y.high;
  if (log_y) {
    low = 0.8 * e.least_positive;
    high = 1.25 * e.y.high;
  } else if (!e.y.empty() && e.y.low < 0.0) {
    low = 1.05 * e.y.low;
  }
  return fmt::format("x_low = {}\nx_high = {}\ny_low = {}\ny_high = {}\nlog_y = {}\n",
                     e.x.low - x_margin, e.x.high + x_margin, low, high, log_y ? 1 : 0);
}

/// A slanted name takes height of the figure.
std::string shortened(const std::string& name) {
  constexpr std::size_t kMostLetters = 20;
  std::size_t letters = 0;
  for (std::size_t i = 0; i < name.size(); ++i) {
    const bool begins = (static_cast<unsigned char>(name[i]) & 0xc0U) != 0x80U;  // in UTF-8
    if (begins && ++letters > kMostLetters) return name.substr(0, i) + "…";
  }
  return name;
}

/// Names below the axis, slanted where there is no room, and how much of the height they take. As
/// labels: gnuplot takes a tic's text for a format, and warns of long ones that are rotated.
std::string name_axis(const CurveFigure& figure) {
  std::string texts, tics, labels;
  double widest_cm = 0.0;
  for (const std::string& name : figure.names) {
    widest_cm = std::max(widest_cm, text_cm(shortened(name)));
  }
  const auto count = static_cast<double>(figure.names.size());
  const bool is_slanted = 1.1 * widest_cm > (figure.text.width_cm - 1.5) / (count + 1.0);
  for (std::size_t i = 0; i < figure.names.size(); ++i) {
    const std::size_t tag = 3001 + i;
    texts += fmt::format("text_{} = {}\n", tag, gnuplot_text(shortened(figure.names[i])));
    tics += fmt::format("{}\"\" {}", i == 0 ? "" : ", ", i + 1);
    labels += fmt::format(
        "set label {0} text_{0} at first {1}, screen (bottom_cm + x_axis_cm - 0.3) / height_cm {2} "
        "noenhanced; ",
        tag, i + 1, is_slanted ? "right rotate by 30" : "center");
  }
  std::string commands;
  if (!figure.names.empty()) {
    commands = fmt::format(
        "set xtics ({}); {}unset xlabel; set label 3000 x_label at graph 0.5, screen (bottom_cm + "
        "0.3) / height_cm center noenhanced",
        tics, labels);
  }
  return texts + fmt::format("named = {}\nx_axis_cm = {:.3f}\nname_tics = {}\n",
                             figure.names.empty() ? 0 : 1,
                             is_slanted ? 1.15 + 0.5 * widest_cm : 1.0, gnuplot_text(commands));
}

// With one series, the legend says what dots, line and band mean, as far as there are any; with
// several, their names.
std::vector<LegendEntry> legend_of(const CurveFigure& figure, bool intervals, bool equal) {
  using Sample = LegendEntry::Sample;
  const auto line = [](std::size_t s) {
    return fmt::format("lw 1.5 lc rgb \"#{}\"", kSeriesColours[s]);
  };
  std::vector<LegendEntry> entries;
  if (figure.series.size() == 1) {
    const std::string colour = kSeriesColours[0];
    if (equal && figure.names.empty()) return {{Sample::linespoint, line(0), "every run"}};
    entries = {{Sample::point, "ps 0.28 lc rgb \"#70" + colour + "\"", "run"},
               {figure.names.empty() ? Sample::linespoint : Sample::point,
                figure.names.empty() ? line(0) : "ps 0.45 " + line(0), "mean"}};
    if (intervals && !figure.names.empty()) {
      entries.push_back({Sample::line, "lw 2 lc rgb \"#" + colour + "\"",
                         fmt::format("its {:g} % interval", 100.0 * figure.confidence)});
    } else if (intervals) {
      entries.push_back({Sample::area, "fs solid noborder fc rgb \"#b0" + colour + "\"",
                         fmt::format("its {:g} % interval", 100.0 * figure.confidence)});
    }
    return entries;
  }
  for (std::size_t s = 0; s < figure.series.size(); ++s) {
    entries.push_back({figure.names.empty() ? Sample::linespoint : Sample::point,
                       figure.names.empty() ? line(s) : "ps 0.45 " + line(s),
                       figure.series[s].name});
  }
  return entries;
}

}  // namespace

void draw_curve(const std::filesystem::path& folder, const std::string& stem,
                const CurveFigure& figure) {
  const Extent e = extent_of(figure);
  const std::size_t count = figure.series.size();
  if (e.x.empty() || count > kSeriesColours.size()) {
    throw std::invalid_argument("a curve needs a point and at most 7 series");
  }
  const auto all_points_equal = [](const CurveSeries& series) {
    return std::all_of(series.points.begin(), series.points.end(), all_equal);
  };
  const bool equal =
      e.most > 1 && std::all_of(figure.series.begin(), figure.series.end(), all_points_equal);
  std::string note = seeds_note(e.least, e.most, e.failed);
  if (equal) {
    note += ", all of them equal";
  } else if (count > 1 && e.intervals) {
    note += fmt::format("; dots: runs, side by side; {}: their {:g} % intervals",
                        figure.names.empty() ? "lines: means; bands" : "large ones: means; bars",
                        100.0 * figure.confidence);
  }
  note += losses_note(figure.series);
  const FigureFrame frame(figure.text, note, legend_of(figure, e.intervals, equal),
                          FigureFrame::Legend::above);
  std::string variables = frame.variables(stem, figure.text.height_cm);
  variables += axes(figure, e) + name_axis(figure);
  variables += "colours = \"";
  for (std::size_t s = 0; s < count; ++s) variables += fmt::format("{} ", kSeriesColours[s]);
  variables += fmt::format("\"\nx_label = {}\ny_label = {}\nbars = {}\nseries = {}\nlosses = {}\n",
                           gnuplot_text(figure.x_label), gnuplot_text(figure.y_label),
                           e.lonely_interval || !figure.names.empty() ? 1 : 0, count,
                           losses_note(figure.series).empty() ? 0 : 1);
  draw_figure(folder, stem, csv_of(figure, e.jitter()), figure.text, variables, kCurveCommands);
}

}  // namespace tether
