#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <stdexcept>

#include "tools/experiment/figures/figure_script.hpp"
#include "tools/experiment/figures/figures.hpp"

namespace tether {
namespace {

// By family; lines of one family differ in dashes and points.
constexpr std::array kFamilyColours{"d55e00", "cc79a7", "009e73", "0072b2",
                                    "e69f00", "56b4e9", "000000"};
constexpr std::array kPoints{7, 5, 9, 13, 6, 4, 8, 12};
constexpr std::array kDashes{"1", "(8,4)", "(2,3)", "(8,3,2,3)"};

constexpr double kYAxis_cm = 1.35, kXAxis_cm = 0.95, kLabelGap_cm = 0.34, kLeader_cm = 0.42;

constexpr char kComparisonCommands[] = R"gnuplot(
  set xlabel x_label noenhanced offset 0,0.4
  set ylabel y_label noenhanced offset 0.3,0
  set logscale y
  set format y "%g"
  set grid ytics mytics lc rgb "#c8c8c8" lw 0.6, lc rgb "#f0f0f0" lw 0.4
  set mytics 10
  set xrange [x_left:x_right]
  set yrange [y_low:y_high]
  eval xtics_command
  set lmargin at screen left_cm / width_cm
  set rmargin at screen right_cm / width_cm
  set tmargin at screen plot_top_cm / height_cm
  set bmargin at screen plot_bottom_cm / height_cm
  eval direct_labels
  command = "plot NaN"
  do for [s = 1 : series] {
    colour = word(colours, s)
    if (s == floor_series) {
      command = command . sprintf(", floor_value with lines lw 1 dt (10,4) lc rgb '#%s'", colour)
    } else {
      rows = sprintf("$1 == %d ?", s)
      command = command . sprintf(", data every ::1 using (%s $2 : NaN):4:5 " \
        . "with filledcurves fs solid noborder fc rgb '#d0%s'", rows, colour)
      command = command . sprintf(", data every ::1 using (%s $2 : NaN):3 " \
        . "with linespoints pt %s ps 0.45 lw 1.5 dt %s lc rgb '#%s'", rows, word(points, s), \
        word(dashes, s), colour)
      if (losses) {
        command = command . sprintf(", data every ::1 using (%s ($8 > 0 ? $2 : NaN) : NaN):3 " \
          . "with points pt 2 ps 0.6 lw 1 lc rgb '#000000'", rows)
      }
    }
  }
  eval command
)gnuplot";

std::string family_of(const std::string& name) { return name.substr(0, name.find(',')); }

struct LineStyle {
  std::string colour;
  int point = 7;
  std::string dash = "1";
};

std::vector<LineStyle> styles_of(const ComparisonFigure& figure) {
  std::map<std::string, std::size_t> families, members;
  std::vector<LineStyle> styles;
  for (const CurveSeries& series : figure.series) {
    if (series.name == figure.floor) {
      styles.push_back({"444444", 7, "1"});
      continue;
    }
    const std::string family = family_of(series.name);
    const std::size_t colour = families.emplace(family, families.size()).first->second;
    const std::size_t member = members[family]++;
    styles.push_back({kFamilyColours[colour % kFamilyColours.size()],
                      kPoints[member % kPoints.size()], kDashes[member % kDashes.size()]});
  }
  return styles;
}

/// Where the axes lie, and how far they reach.
struct Frame {
  double left_cm, right_cm, bottom_cm, top_cm;
  LeastMost x, y;

  double height_of(double value) const {
    return bottom_cm + (top_cm - bottom_cm) * std::log(value / y.low) / std::log(y.high / y.low);
  }
};

bool is_drawn(double value) { return std::isfinite(value) && value > 0.0; }

/// The value beside which a series' label stands: its last mean; of the floor, its first.
double end_of(const CurveSeries& series, const ComparisonFigure& figure) {
  double value = std::numeric_limits<double>::quiet_NaN(), x = 0.0;
  for (const PlottedPoint& p : series.points) {
    const bool is_later = !std::isfinite(value) || (figure.reversed ? p.x < x : p.x > x);
    if (!is_drawn(p.mean) || !is_later) continue;
    value = p.mean;
    x = p.x;
  }
  return value;
}

Frame frame_of(const ComparisonFigure& figure, const FigureFrame& around) {
  Frame frame{
      kYAxis_cm, 0.0, around.bottom_cm() + kXAxis_cm, figure.text.height_cm - around.top_cm(),
      {},        {}};
  double widest_cm = 0.0;
  for (const CurveSeries& series : figure.series) {
    widest_cm = std::max(widest_cm, text_cm(series.name));
    for (const PlottedPoint& p : series.points) {
      frame.x.add(p.x);
      for (const double y : {p.mean, p.interval.low, p.interval.high}) {
        if (is_drawn(y)) frame.y.add(y);
      }
    }
  }
  frame.right_cm = figure.text.width_cm - widest_cm - kLeader_cm - 0.1;
  if (frame.y.empty()) frame.y = {0.1, 1.0};
  frame.y = {0.75 * frame.y.low, 1.5 * frame.y.high};
  return frame;
}

// Near their lines, one above the other without overlap: least squares under that constraint, by
// pooling adjacent violators.
std::vector<double> spread(const std::vector<double>& wanted_cm, double low_cm, double high_cm) {
  struct Pool {
    double sum = 0.0;
    std::size_t count = 0;
    double mean() const { return sum / static_cast<double>(count); }
  };
  std::vector<Pool> pools;
  for (std::size_t i = 0; i < wanted_cm.size(); ++i) {
    pools.push_back({wanted_cm[i] - kLabelGap_cm * static_cast<double>(i), 1});
    while (pools.size() > 1 && pools[pools.size() - 2].mean() > pools.back().mean()) {
      const Pool last = pools.back();
      pools.pop_back();
      pools.back().sum += last.sum;
      pools.back().count += last.count;
    }
  }
  const double highest = high_cm - kLabelGap_cm * (static_cast<double>(wanted_cm.size()) - 1.0);
  std::vector<double> placed;
  for (const Pool& pool : pools) {
    for (std::size_t i = 0; i < pool.count; ++i) {
      const double start = std::max(low_cm, std::min(pool.mean(), highest));
      placed.push_back(start + kLabelGap_cm * static_cast<double>(placed.size()));
    }
  }
  return placed;
}

/// Names beside the lines' ends, with lines to them.
std::string direct_labels(const ComparisonFigure& figure, const Frame& frame,
                          const std::vector<LineStyle>& styles) {
  std::vector<std::pair<double, std::size_t>> ends;
  for (std::size_t s = 0; s < figure.series.size(); ++s) {
    const double end = end_of(figure.series[s], figure);
    if (std::isfinite(end)) ends.emplace_back(frame.height_of(end), s);
  }
  std::sort(ends.begin(), ends.end());
  std::vector<double> wanted_cm;
  for (const auto& [height_cm, s] : ends) wanted_cm.push_back(height_cm);
  const std::vector<double> placed_cm =
      spread(wanted_cm, frame.bottom_cm - 0.5, frame.top_cm - 0.05);
  std::string texts, commands;
  for (std::size_t i = 0; i < ends.size(); ++i) {
    const std::size_t s = ends[i].second, tag = 2001 + s;
    texts += fmt::format("text_{} = {}\n", tag, gnuplot_text(figure.series[s].name));
    commands += fmt::format(
        "set arrow {0} from screen {1:.3f} / width_cm, screen {2:.3f} / height_cm to screen "
        "{3:.3f} / width_cm, screen {4:.3f} / height_cm nohead lw 0.6 dt {7} lc rgb \"#{5}\"; "
        "set label {0} text_{0} at screen {6:.3f} / width_cm, screen {4:.3f} / height_cm left "
        "noenhanced font \",6\" tc rgb \"#{5}\"; ",
        tag, frame.right_cm, wanted_cm[i], frame.right_cm + kLeader_cm - 0.08, placed_cm[i],
        styles[s].colour, frame.right_cm + kLeader_cm, styles[s].dash);
  }
  return texts + "direct_labels = " + gnuplot_text(commands) + "\n";
}

std::string comparison_csv(const ComparisonFigure& figure) {
  std::string csv = "series,x,mean,low,high,n,failed,lost,name\n";
  for (std::size_t s = 0; s < figure.series.size(); ++s) {
    for (const PlottedPoint& p : figure.series[s].points) {
      csv += fmt::format("{},{},{},{},{},{},{},{},{}\n", s + 1, p.x, p.mean, p.interval.low,
                         p.interval.high, p.succeeded(), p.runs.size() - p.succeeded(), p.lost,
                         csv_cell(figure.series[s].name));
    }
  }
  return csv;
}

/// A tic at each value; a number where the one before leaves room.
std::string tics(const ComparisonFigure& figure, const Frame& frame) {
  std::set<double> places;
  for (const CurveSeries& series : figure.series) {
    for (const PlottedPoint& p : series.points) places.insert(p.x);
  }
  const double cm = (frame.right_cm - frame.left_cm) / std::max(1e-9, frame.x.high - frame.x.low);
  std::string list;
  double last_end_cm = -std::numeric_limits<double>::infinity();
  for (const double x : places) {
    const std::string number = fmt::format("{:g}", x);
    const double half_cm = 0.5 * text_cm(number);
    const bool has_room = cm * x - half_cm > last_end_cm;
    if (has_room) last_end_cm = cm * x + half_cm;
    list += fmt::format("{}\"{}\" {}", list.empty() ? "" : ", ", has_room ? number : "", x);
  }
  return "set xtics font \",6\" (" + list + ")";
}

std::string note_of(const ComparisonFigure& figure) {
  std::size_t least = static_cast<std::size_t>(-1), most = 0, failed = 0;
  for (const CurveSeries& series : figure.series) {
    for (const PlottedPoint& p : series.points) {
      const std::size_t n = p.succeeded();
      least = std::min(least, n);
      most = std::max(most, n);
      failed += p.runs.size() - n;
    }
  }
  return seeds_note(least, most, failed) +
         fmt::format("; lines: means, bands: {:g} % intervals", 100.0 * figure.confidence) +
         losses_note(figure.series) + (figure.note.empty() ? "" : ". " + figure.note);
}

}  // namespace

void draw_comparison(const std::filesystem::path& folder, const std::string& stem,
                     const ComparisonFigure& figure) {
  const FigureFrame around(figure.text, note_of(figure), {}, FigureFrame::Legend::above);
  const Frame frame = frame_of(figure, around);
  if (frame.x.empty() || figure.series.size() > 14) {
    throw std::invalid_argument("a comparison needs a point and at most 14 series");
  }
  const std::vector<LineStyle> styles = styles_of(figure);
  double margin = 0.02 * (frame.x.high - frame.x.low);
  if (margin <= 0.0) margin = 0.1;
  double left = frame.x.low - margin, right = frame.x.high;
  if (figure.reversed) {
    left = frame.x.high + margin;
    right = frame.x.low;
  }
  std::size_t floor_series = 0;
  double floor_value = 0.0;
  std::string colours, points, dashes;
  for (std::size_t s = 0; s < figure.series.size(); ++s) {
    colours += styles[s].colour + " ";
    points += fmt::format("{} ", styles[s].point);
    dashes += fmt::format("{} ", styles[s].dash);
    if (figure.series[s].name != figure.floor || figure.series[s].points.empty()) continue;
    floor_series = s + 1;
    floor_value = end_of(figure.series[s], figure);
  }
  std::string variables = around.variables(stem, figure.text.height_cm);
  variables += fmt::format(
      "x_left = {}\nx_right = {}\ny_low = {}\ny_high = {}\nleft_cm = {:.3f}\nright_cm = {:.3f}\n"
      "plot_bottom_cm = {:.3f}\nplot_top_cm = {:.3f}\n",
      left, right, frame.y.low, frame.y.high, frame.left_cm, frame.right_cm, frame.bottom_cm,
      frame.top_cm);
  variables += fmt::format(
      "x_label = {}\ny_label = {}\ncolours = \"{}\"\npoints = \"{}\"\ndashes = \"{}\"\n"
      "series = {}\nfloor_series = {}\nfloor_value = {}\nxtics_command = {}\nlosses = {}\n",
      gnuplot_text(figure.x_label), gnuplot_text(figure.y_label), colours, points, dashes,
      figure.series.size(), floor_series, floor_value, gnuplot_text(tics(figure, frame)),
      losses_note(figure.series).empty() ? 0 : 1);
  variables += direct_labels(figure, frame, styles);
  draw_figure(folder, stem, comparison_csv(figure), figure.text, variables, kComparisonCommands);
}

}  // namespace tether
