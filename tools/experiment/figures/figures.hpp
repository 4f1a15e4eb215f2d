#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "tools/experiment/statistics/statistics.hpp"

namespace tether {

// Figures for one column of print, by gnuplot. Each function writes into `folder`, which exists,
// `stem`.svg, .pdf, .png and .tex (TikZ: \usepackage{gnuplot-lua-tikz}, of gnuplot) with the data
// (.csv) and the script (.gp) beside them; the script can be restyled and run again there: gnuplot
// STEM.gp. They throw std::runtime_error if a file cannot
// be written, gnuplot is missing (naming the package) or fails. Colours are Okabe and Ito's and,
// for scales, cividis (Nuñez, Anderton, Renslow, PLOS ONE 13(7), 2018), whose lightness only rises:
// all readers can tell them apart, and so can a grey print. No text is smaller than 7 pt. Values
// that are not finite are left out of drawings, and the figure says how many runs failed. All need
// at least one point; else std::invalid_argument.

/// Texts of a figure. They are taken literally.
struct FigureText {
  std::string title;       ///< above; papers have a caption of their own instead
  std::string plant;       ///< small, below; none if empty
  std::string experiment;  ///< the same: its name
  double width_cm = 8.8;
  double height_cm = 6.5;  ///< trajectories and risk maps choose their own
};

struct PointInPlane {
  double x_m = 0.0;
  double y_m = 0.0;
};

struct TrajectoryPanel {
  std::string title;  ///< "PRR 0.45, ε = 19.8 m"
  std::vector<PointInPlane> planned, actual;
};

/// Planned (green) and actual (blue) paths of single runs within the walls, on equal axes.
struct TrajectoryFigure {
  FigureText text;
  std::string note;  ///< below, such as which seed: "seed 7"
  double half_extent_m = 0.0;
  std::vector<TrajectoryPanel> panels;  ///< 1 to 6; two side by side, three from 12 cm width on
};
void draw_trajectories(const std::filesystem::path& folder, const std::string& stem,
                       const TrajectoryFigure& figure);

/// One setting's runs.
struct PlottedPoint {
  double x = 0.0;
  std::vector<double> runs;  ///< NaN: failed
  double mean = 0.0;
  Interval interval;  ///< interval of the mean; NaN: none, as with one run
  /// How many of the vehicles were lost: if any, the mean is that of two humps, and its point has a
  /// cross.
  std::size_t lost = 0;
  Interval x_interval = {};  ///< where x is a mean, too

  /// How many runs have a result.
  std::size_t succeeded() const {
    return static_cast<std::size_t>(
        std::count_if(runs.begin(), runs.end(), [](double run) { return std::isfinite(run); }));
  }
};

struct CurveSeries {
  std::string name;  ///< in the legend, if there are several
  std::vector<PlottedPoint> points;
};

/// A result against a parameter: one dot for each run, a line through the means, and a band of
/// their intervals. Where a band has no neighbour to reach to, there are bars, too. Where x is a
/// name, there are bars only, the series side by side.
struct CurveFigure {
  FigureText text;
  std::string x_label;             ///< with unit: "δ [ms]"
  std::vector<std::string> names;  ///< names for x = 1, 2 …; none: x is a number
  std::string y_label = "ε [m]";
  double confidence = kConfidence;  ///< confidence of the intervals, for the legend
  bool log_y = false;               ///< else from 0; values that are not positive are left out
  std::vector<CurveSeries> series;  ///< up to 7
};
void draw_curve(const std::filesystem::path& folder, const std::string& stem,
                const CurveFigure& figure);

/// Many series on a log axis: lines through means with bands of their intervals, and each name
/// beside its line's end. Series whose names are the same up to the first comma share a colour and
/// differ in dashes and points.
struct ComparisonFigure {
  FigureText text;
  std::string x_label;
  std::string y_label = "ε [m]";
  std::string note;  ///< below, after the number of seeds
  double confidence = kConfidence;
  std::string floor;                ///< the series that is a dashed line at its last mean for all x
  bool reversed = false;            ///< x falls to the right
  std::vector<CurveSeries> series;  ///< up to 14; their runs only count
};
void draw_comparison(const std::filesystem::path& folder, const std::string& stem,
                     const ComparisonFigure& figure);

/// Two results of each setting, of which less is better, against each other on log axes: means with
/// their intervals, and a line along those that no other beats in both (statistics/pareto.hpp).
/// What is not positive is left out.
struct ParetoFigure {
  FigureText text;
  std::string x_label;
  std::string y_label = "ε [m]";
  double confidence = kConfidence;
  std::vector<CurveSeries> series;  ///< up to 7
};
void draw_pareto(const std::filesystem::path& folder, const std::string& stem,
                 const ParetoFigure& figure);

/// A mean of two parameters.
struct HeatCell {
  enum class Mark { none, tied, best };

  double x = 0.0;
  double y = 0.0;
  double mean = 0.0;  ///< NaN: no run succeeded; grey
  Interval interval;  ///< interval of the mean: in the data; the widest is named below the figure
  std::size_t n = 0;
  std::size_t failed = 0;  ///< runs that are not in the mean
  Mark mark = Mark::none;  ///< tied: the data cannot separate it from the best of its column
};

/// One box for each cell. Boxes have even steps, whatever the parameters' values; x and y ascend.
struct HeatmapFigure {
  FigureText text;
  std::string x_label;  ///< "PRR"
  std::string y_label;  ///< "τ [s]"
  std::string value_label = "mean ε [m]";
  bool log_colours = false;  ///< if all means are positive
  std::vector<HeatCell> cells;
};
void draw_heatmap(const std::filesystem::path& folder, const std::string& stem,
                  const HeatmapFigure& figure);

/// Risk from one point of the path on, as a mean over the seeds.
struct RiskPoint {
  double time_s = 0.0;  ///< since the path's start
  double x_m = 0.0;
  double y_m = 0.0;
  double mean = 0.0;  ///< NaN: no run succeeded
  Interval interval;
  std::size_t n = 0;
};

struct TimeSpan {
  double start_s = 0.0;
  double end_s = 0.0;
};

/// Where the path bends by more than half of its sharpest bend (heading per metre). None on a
/// straight line or a circle.
std::vector<TimeSpan> sharp_turns(const std::vector<RiskPoint>& path);

/// The path coloured by risk, with start and direction; below, risk against time with its band.
struct RiskMapFigure {
  FigureText text;
  std::string value_label = "mean ε [m]";
  std::string note;  ///< below, after the number of seeds: what the value is
  double confidence = kConfidence;
  double half_extent_m = 0.0;
  std::size_t failed = 0;         ///< runs that are in no mean
  std::vector<RiskPoint> points;  ///< in order of time
  std::vector<TimeSpan> turns;    ///< shaded in both panels; sharp_turns() finds them
};
void draw_risk_map(const std::filesystem::path& folder, const std::string& stem,
                   const RiskMapFigure& figure);

}  // namespace tether
