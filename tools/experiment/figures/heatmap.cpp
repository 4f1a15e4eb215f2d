#include <fmt/format.h>

#include <cmath>
#include <set>
#include <stdexcept>

#include "tools/experiment/figures/figure_script.hpp"
#include "tools/experiment/figures/figures.hpp"

namespace tether {
namespace {

constexpr double kHeatmapCharacter_cm = 0.16;  // width of a character at 7 pt
constexpr double kAround_cm = 3.15;            // beside the cells: labels and colour bar

constexpr char kHeatmapCommands[] = R"gnuplot(
  set xlabel x_label noenhanced offset 0,0.4
  set ylabel y_label noenhanced offset 1,0
  set cblabel value_label noenhanced offset 0.3,0
  set cbrange [colour_low:colour_high]
  if (log_colours) { set logscale cb }
  set colorbox user noborder origin screen 1 - 1.65 / width_cm, screen (bottom_cm + 1.0) / height_cm \
    size screen 0.28 / width_cm, screen 1 - (top_cm + bottom_cm + 1.0) / height_cm
  set xrange [0.5 : columns + 0.5]
  set yrange [0.5 : rows + 0.5]
  set xtics () scale 0.3
  set ytics () scale 0.3
  eval x_tics
  eval y_tics
  set lmargin at screen 1.3 / width_cm
  set rmargin at screen 1 - 1.85 / width_cm
  set tmargin at screen 1 - top_cm / height_cm
  set bmargin at screen (bottom_cm + 1.0) / height_cm
  part(v) = log_colours ? log(v / colour_low) / log(colour_high / colour_low) \
    : (v - colour_low) / (colour_high - colour_low)
  command = "plot data every ::1 using ($6 > 0 ? $3 : NaN):4:(0.5):(0.5):5 " \
    . "with boxxyerror lc palette fs solid noborder" \
    . ", data every ::1 using ($6 > 0 ? NaN : $3):4:(0.5):(0.5) " \
    . "with boxxyerror lc rgb '#d8d8d8' fs solid noborder"
  if (written) {
    command = command . ", data every ::1 using ($6 > 0 ? $3 : NaN):4:(sprintf(number, $5)):" \
      . "(part($5) < 0.55 ? 0xffffff : 0x000000) with labels font ',7' tc rgb variable"
  }
  # Red with a white rim, to be seen on all colours.
  boxes(mark, style) = sprintf(", data every ::1 using ($8 == %d ? $3 : NaN):4:(0.43):(0.43) " \
    . "with boxxyerror %s fs empty", mark, style)
  command = command . boxes(1, "lc rgb '#ffffff' lw 2.2") \
    . boxes(1, "lc rgb '#d00000' lw 1.3 dt (5,4)") \
    . boxes(2, "lc rgb '#ffffff' lw 3.2") . boxes(2, "lc rgb '#d00000' lw 2")
  eval command
)gnuplot";

using Values = std::set<double>;

std::size_t index_of(const Values& values, double value) {
  return static_cast<std::size_t>(std::distance(values.begin(), values.find(value))) + 1;
}

// `set xtics add ("0.45" 3)`: only as many as there is room for.
std::string tics(const char* axis, const Values& values, double each_cm, bool across) {
  std::size_t widest = 1, i = 0;
  for (const double v : values) widest = std::max(widest, fmt::format("{:g}", v).size());
  const double room_cm = across ? kHeatmapCharacter_cm * (static_cast<double>(widest) + 0.7) : 0.32;
  const auto every = static_cast<std::size_t>(std::max(1.0, std::ceil(room_cm / each_cm)));
  std::string list;
  for (const double v : values) {
    if (i++ % every == 0) list += fmt::format("{}\"{:g}\" {}", list.empty() ? "" : ", ", v, i);
  }
  return fmt::format("{}_tics = {}\n", axis,
                     gnuplot_text(fmt::format("set {}tics ({})", axis, list)));
}

struct Cells {
  Values x, y;
  LeastMost mean;
  std::size_t least = static_cast<std::size_t>(-1), most = 0, failed = 0;
  double widest = 0.0;  // half of an interval
  bool missing = false, tied = false, best = false;

  explicit Cells(const HeatmapFigure& figure) {
    for (const HeatCell& cell : figure.cells) {
      x.insert(cell.x);
      y.insert(cell.y);
      failed += cell.failed;
      if (std::isfinite(cell.mean)) {
        mean.add(cell.mean);
        least = std::min(least, cell.n);
        most = std::max(most, cell.n);
        if (std::isfinite(half_width(cell.interval))) {
          widest = std::max(widest, half_width(cell.interval));
        }
      }
      missing = missing || !std::isfinite(cell.mean);
      tied = tied || cell.mark == HeatCell::Mark::tied;
      best = best || cell.mark == HeatCell::Mark::best;
    }
    if (mean.empty()) mean = {0.0, 1.0}, least = 0;
  }
};

std::string colours(const HeatmapFigure& figure, const Cells& cells) {
  const bool log_colours = figure.log_colours && cells.mean.low > 0.0;
  double low = cells.mean.low, high = cells.mean.high;
  if (!(low < high)) {  // one value is in the middle of some range
    const double margin = low == 0.0 ? 1.0 : 0.1 * std::abs(low);
    low -= margin;
    high += margin;
  }
  return fmt::format("colour_low = {}\ncolour_high = {}\nlog_colours = {}\n", low, high,
                     log_colours ? 1 : 0);
}

// With as many digits as tell cells apart; empty if there is no room for them.
std::string number_format(const Cells& cells, double each_cm, double row_cm) {
  const double largest = std::max(std::abs(cells.mean.low), std::abs(cells.mean.high));
  for (int digits = largest < 10.0 ? 2 : 1; digits >= 0; --digits) {
    const std::string widest = fmt::format("{:.{}f}", largest, digits);
    const double characters = static_cast<double>(widest.size()) - (digits > 0 ? 0.5 : 0.0);
    if (kHeatmapCharacter_cm * (characters + 0.5) <= each_cm && row_cm >= 0.3) {
      return fmt::format("%.{}f", digits);
    }
    if (digits == 1 && largest < 10.0) break;  // whole metres would hide what matters
  }
  return "";
}

std::string csv_of(const HeatmapFigure& figure, const Cells& cells) {
  std::string csv = "x,y,column,row,mean,n,failed,mark,low,high\n";
  for (const HeatCell& cell : figure.cells) {
    csv += fmt::format("{},{},{},{},{},{},{},{},{},{}\n", cell.x, cell.y, index_of(cells.x, cell.x),
                       index_of(cells.y, cell.y), cell.mean, std::isfinite(cell.mean) ? cell.n : 0,
                       cell.failed, static_cast<int>(cell.mark), cell.interval.low,
                       cell.interval.high);
  }
  return csv;
}

std::vector<LegendEntry> legend_of(const Cells& cells) {
  using Sample = LegendEntry::Sample;
  std::vector<LegendEntry> entries;
  if (cells.best) {
    entries.push_back(
        {Sample::area, "fs empty border lc rgb \"#d00000\" lw 2", "best of its column"});
  }
  if (cells.tied) {
    entries.push_back({Sample::area, "fs empty border lc rgb \"#d00000\" lw 1.3 dt (5,4)",
                       "not separable from it"});
  }
  if (cells.missing) {
    entries.push_back({Sample::area, "fs solid noborder fc rgb \"#d8d8d8\"", "no run succeeded"});
  }
  return entries;
}

}  // namespace

void draw_heatmap(const std::filesystem::path& folder, const std::string& stem,
                  const HeatmapFigure& figure) {
  if (figure.cells.empty()) throw std::invalid_argument("a heatmap needs a cell");
  const Cells cells(figure);
  const FigureText& text = figure.text;
  std::string note = seeds_note(cells.least, cells.most, cells.failed);
  if (cells.widest > 0.0) note += fmt::format("; 95 % intervals up to ±{:.2g}", cells.widest);
  const double each_cm = (text.width_cm - kAround_cm) / static_cast<double>(cells.x.size());
  const double row_cm = (text.height_cm - 2.8) / static_cast<double>(cells.y.size());
  const std::string number = number_format(cells, each_cm, row_cm);
  const FigureFrame frame(text, note, legend_of(cells), FigureFrame::Legend::above);
  std::string variables = frame.variables(stem, text.height_cm);
  variables += colours(figure, cells);
  variables += tics("x", cells.x, each_cm, true) + tics("y", cells.y, row_cm, false);
  variables += fmt::format(
      "x_label = {}\ny_label = {}\nvalue_label = {}\ncolumns = {}\nrows = {}\n"
      "written = {}\nnumber = {}\n",
      gnuplot_text(figure.x_label), gnuplot_text(figure.y_label), gnuplot_text(figure.value_label),
      cells.x.size(), cells.y.size(), number.empty() ? 0 : 1, gnuplot_text(number));
  draw_figure(folder, stem, csv_of(figure, cells), figure.text, variables, kHeatmapCommands);
}

}  // namespace tether
