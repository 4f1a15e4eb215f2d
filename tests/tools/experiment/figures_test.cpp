#include "tools/experiment/figures/figures.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include "common/path/simple_curves.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/tex.hpp"
#include "tests/tools/experiment/laws.hpp"
#include "tests/tools/experiment/nan.hpp"
#include "tools/base/process.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;
using test::EightyTwenty;

PlottedPoint curve_point(double x, const std::vector<double>& runs, std::uint64_t seed) {
  const Summary s = summarize(runs, kConfidence, seed);
  return {x, runs, s.mean, s.mean_interval};
}

/// Draws into a temporary folder, or into $TETHER_FIGURES/TEST to look at.
class ExperimentFiguresTest : public ::testing::Test {
 protected:
  ExperimentFiguresTest() {
    if (const char* kept = std::getenv("TETHER_FIGURES")) {
      folder_ = fs::path(kept) / ::testing::UnitTest::GetInstance()->current_test_info()->name();
      fs::remove_all(folder_);
      fs::create_directories(folder_);
    }
    text_ = {"", "ode", "paper"};
  }

  std::string contents(const std::string& name) const { return test::contents(folder_ / name); }

  // All five files are there, each of its kind, and the script alone draws the pictures again.
  void expect_drawn(const std::string& stem) const {
    expect_pictures(stem);
    EXPECT_FALSE(contents(stem + ".csv").empty());
    for (const char* format : {".svg", ".pdf", ".png", ".tex"})
      fs::remove(folder_ / (stem + format));
    EXPECT_EQ(run_process({"sh", "-c", "exec gnuplot " + stem + ".gp >said 2>&1"}, folder_), 0);
    EXPECT_EQ(contents("said"), "") << "gnuplot warns";
    fs::remove(folder_ / "said");
    expect_pictures(stem);
  }

  void expect_pictures(const std::string& stem) const {
    const std::string svg = contents(stem + ".svg");
    EXPECT_NE(svg.find("<svg"), std::string::npos);
    EXPECT_NE(svg.find("</svg>"), std::string::npos) << "cut off";
    EXPECT_EQ(contents(stem + ".pdf").substr(0, 5), "%PDF-");
    EXPECT_EQ(contents(stem + ".png").substr(1, 3), "PNG");
    EXPECT_GT(contents(stem + ".png").size(), 5000u);
    test::expect_tex(contents(stem + ".tex"));
  }

  // A text that the figure must show.
  bool shows(const std::string& stem, const std::string& text) const {
    return contents(stem + ".svg").find(text) != std::string::npos;
  }

  bool has_row(const std::string& stem, const std::string& row) const {
    return ("\n" + contents(stem + ".csv")).find("\n" + row + "\n") != std::string::npos;
  }

  static TrajectoryPanel panel(const std::string& title, double error_m) {
    const FigureEight path({});
    TrajectoryPanel panel{title, {}, {}};
    for (int i = 0; i <= 620; ++i) {
      const PathPoint p = path.at(0.1 * i);
      panel.planned.push_back({p.x_m, p.y_m});
      panel.actual.push_back({std::clamp(p.x_m + error_m * std::sin(0.03 * i), -22.0, 22.0),
                              std::clamp(p.y_m - error_m * std::sin(0.02 * i), -22.0, 22.0)});
    }
    return panel;
  }

  static CurveSeries series(const std::string& name, double scale, std::size_t n) {
    CurveSeries series{name, {}};
    RandomEngine random = random_stream(1, name);
    for (int k = 0; k <= 7; ++k) {
      const double prr = 0.3 + 0.1 * k;
      std::vector<double> runs;
      for (std::size_t i = 0; i < n; ++i) {
        const double luck = EightyTwenty()(random);
        runs.push_back(luck > 10.0 && uniform_01(random) > 1.2 - prr ? 2.0 : scale * luck);
      }
      series.points.push_back(curve_point(prr, runs, 1));
    }
    return series;
  }

  static RiskMapFigure risk_map(std::size_t count) {
    RiskMapFigure figure;
    figure.half_extent_m = 22.0;
    const FigureEight path({});
    for (std::size_t i = 0; i < count; ++i) {
      const double t_s = 62.0 / static_cast<double>(count) * static_cast<double>(i);
      const PathPoint p = path.at(t_s);
      const double risk = 6.0 + 3.0 * std::sin(0.2 * t_s) + 1.5 * std::cos(0.5 * t_s);
      figure.points.push_back({t_s, p.x_m, p.y_m, risk, {0.8 * risk, 1.3 * risk}, 50});
    }
    figure.turns = sharp_turns(figure.points);
    return figure;
  }

  static HeatmapFigure heatmap(int columns, int rows) {
    HeatmapFigure figure;
    figure.x_label = "PRR";
    figure.y_label = "τ [s]";
    for (int i = 0; i < columns; ++i) {
      const int best = 1 + (rows - 1) * (columns - i) / (columns + 1);
      for (int j = 0; j < rows; ++j) {
        HeatCell cell{0.3 + 0.1 * i, 0.5 * (j + 1), 0.0, {}, 50, 0, HeatCell::Mark::none};
        cell.mean = 2.0 + 0.8 * (columns - i) + 0.6 * (j - best) * (j - best);
        if (j == best) cell.mark = HeatCell::Mark::best;
        if (j == best + 1) cell.mark = HeatCell::Mark::tied;
        figure.cells.push_back(cell);
      }
    }
    return figure;
  }

  const test::Folder own_;
  fs::path folder_ = own_.path;
  FigureText text_;
};

TEST_F(ExperimentFiguresTest, TrajectoriesOfFourRuns) {
  TrajectoryFigure figure{text_, "n = 1: single runs, seed 7", 22.0, {}};
  figure.panels = {panel("PRR 1, ε = 1.8 m", 0.8), panel("PRR 0.75, ε = 2.9 m", 2.0),
                   panel("PRR 0.45, ε = 19.8 m", 12.0), panel("PRR 0.3, ε = 22.7 m", 20.0)};
  draw_trajectories(folder_, "trajectories", figure);
  expect_drawn("trajectories");
  EXPECT_TRUE(has_row("trajectories", "1,planned,0,0,ode"));
  EXPECT_TRUE(has_row("trajectories", "1,start,0,0,ode"));
  EXPECT_TRUE(shows("trajectories", "PRR 0.45, ε = 19.8 m"));
  EXPECT_TRUE(shows("trajectories", "plant: ode, experiment: paper"));
  EXPECT_TRUE(shows("trajectories", "seed 7"));
}

TEST_F(ExperimentFiguresTest, TrajectoriesOfOneToSixRuns) {
  for (std::size_t count : {1u, 2u, 3u, 5u, 6u}) {
    TrajectoryFigure figure{text_, "", 22.0, {}};
    figure.text.title = "A title";
    figure.text.width_cm = count == 6 ? 17.8 : 8.8;
    for (std::size_t i = 0; i < count; ++i) figure.panels.push_back(panel("a run", 3.0));
    const std::string stem = "trajectories_" + std::to_string(count);
    draw_trajectories(folder_, stem, figure);
    expect_drawn(stem);
  }
  TrajectoryFigure none{text_, "", 22.0, {}};
  EXPECT_THROW(draw_trajectories(folder_, "none", none), std::invalid_argument);
}

TEST_F(ExperimentFiguresTest, ARunWithoutAnyFinitePoseShowsItsPlannedPath) {
  TrajectoryFigure figure{text_, "", 22.0, {panel("lost at once", 0.0)}};
  figure.panels[0].actual = {{kNaN, kNaN}, {kNaN, 1.0}};
  draw_trajectories(folder_, "trajectories", figure);
  expect_drawn("trajectories");
  EXPECT_EQ(contents("trajectories.csv").find("actual"), std::string::npos);
}

TEST_F(ExperimentFiguresTest, CurveOfOneSeries) {
  CurveFigure figure;
  figure.text = text_;
  figure.x_label = "PRR";
  figure.series = {series("", 1.0, 50)};
  figure.series[0].points[2] = curve_point(0.5, {1.5, kNaN, 2.5, 3.5, INFINITY}, 1);
  draw_curve(folder_, "curve", figure);
  expect_drawn("curve");
  EXPECT_TRUE(shows("curve", "n = 3–50 seeds a point; 2 runs without a value left out"));
  EXPECT_TRUE(shows("curve", "its 95 % interval"));
  const PlottedPoint& p = figure.series[0].points[2];
  std::ostringstream mean;
  mean << "1,mean,0.5,0.5,2.5," << p.interval.low << "," << p.interval.high << ",3,\"\"";
  EXPECT_NE(contents("curve.csv").find("1,mean,0.5,0.5,2.5,"), std::string::npos) << mean.str();
  std::istringstream rows(contents("curve.csv"));
  int runs = 0;
  for (std::string row; std::getline(rows, row);) runs += row.starts_with("1,run,") ? 1 : 0;
  EXPECT_EQ(runs, 7 * 50 + 3);
}

TEST_F(ExperimentFiguresTest, CurveOfThreeSeriesOnALogAxis) {
  CurveFigure figure;
  figure.text = text_;
  figure.text.title = "Three laws, τ = 2 s";
  figure.x_label = "PRR";
  figure.log_y = true;
  figure.series = {series("pid", 1.0, 20), series("it's \"p_{id}\", `x`", 1.4, 20),
                   series("three", 0.6, 20)};
  draw_curve(folder_, "curve", figure);
  expect_drawn("curve");
  EXPECT_TRUE(shows("curve", "n = 20 seeds a point; dots: runs, side by side;"));
  EXPECT_TRUE(shows("curve", "p_{id}"));
}

TEST_F(ExperimentFiguresTest, AComparisonNamesEachLineBesideItsEnd) {
  ComparisonFigure figure;
  figure.text = text_;
  figure.text.title = "Laws";
  figure.x_label = "PRR";
  figure.reversed = true;
  figure.floor = "the floor";
  figure.series = {series("PID, hold", 1.0, 20),
                   series("PID, it's \"p_{id}\", `x`", 1.05, 20),
                   series("tracking, 1 Hz", 0.1, 20),
                   {"the floor", {curve_point(1.0, {0.03, 0.03}, 1)}}};
  draw_comparison(folder_, "laws", figure);
  expect_drawn("laws");
  for (const char* name : {"PID, hold", "p_{id}", "tracking, 1 Hz", "the floor"}) {
    EXPECT_TRUE(shows("laws", name)) << name;
  }
  EXPECT_TRUE(shows("laws", "n = 2–20 seeds a point; lines: means"));
  EXPECT_TRUE(has_row("laws", "4,1,0.03,0.03,0.03,2,0,0,the floor,ode"));
}

TEST_F(ExperimentFiguresTest, CrossOutMeansOfTwoHumpsAndSayHowManyWereLost) {
  PlottedPoint lossy = curve_point(0.5, {1.0, 2.0, 22.0}, 1);
  lossy.lost = 1;
  ComparisonFigure comparison;
  comparison.text = text_;
  comparison.series = {{"a law", {lossy, curve_point(1.0, {1.0, 2.0, 3.0}, 1)}}};
  draw_comparison(folder_, "lossy", comparison);
  expect_drawn("lossy");
  EXPECT_TRUE(shows("lossy", "33 % of"));
  CurveFigure curve;
  curve.text = text_;
  curve.series = comparison.series;
  draw_curve(folder_, "lossy_curve", curve);
  expect_drawn("lossy_curve");
  EXPECT_TRUE(shows("lossy_curve", "33 % of"));
  curve.series[0].points[0].lost = 0;
  draw_curve(folder_, "healthy", curve);
  EXPECT_FALSE(shows("healthy", "lost"));
}

TEST_F(ExperimentFiguresTest, ComparisonsOfDegenerateDataAreDrawn) {
  ComparisonFigure figure;
  figure.text = text_;
  figure.series = {{"one point", {curve_point(0.5, {1.0, 2.0, 6.0}, 1)}}};
  draw_comparison(folder_, "one_point", figure);
  expect_drawn("one_point");
  figure.series = {{"failed", {curve_point(0.5, {kNaN}, 1)}},
                   {"zeros", {curve_point(0.5, {0.0, 0.0}, 1), curve_point(0.6, {0.0}, 1)}}};
  draw_comparison(folder_, "nothing", figure);
  expect_drawn("nothing");
  EXPECT_TRUE(shows("nothing", "1 run without a value left out"));
  EXPECT_THROW(draw_comparison(folder_, "none", {}), std::invalid_argument);
}

TEST_F(ExperimentFiguresTest, OneRunAPointHasNoBand) {
  CurveFigure figure;
  figure.text = text_;
  figure.x_label = "δ [ms]";
  figure.series = {{"", {}}};
  for (int i = 0; i < 6; ++i) {
    figure.series[0].points.push_back(curve_point(100.0 * i, {2.0 + 0.3 * i}, 1));
  }
  draw_curve(folder_, "curve", figure);
  expect_drawn("curve");
  EXPECT_TRUE(shows("curve", "n = 1 seed a point"));
  EXPECT_FALSE(shows("curve", "interval"));
  EXPECT_TRUE(has_row("curve", "1,mean,500,500,3.5,nan,nan,1,0,,ode"));
}

TEST_F(ExperimentFiguresTest, CurvesOfDegenerateDataAreDrawn) {
  CurveFigure figure;
  figure.text = text_;
  figure.x_label = "PRR";
  figure.series = {{"one point", {curve_point(0.5, {1.0, 2.0, 6.0, 2.0, 2.5}, 1)}}};
  draw_curve(folder_, "one_point", figure);
  expect_drawn("one_point");
  figure.series = {{"equal", {curve_point(0.5, {0, 0, 0}, 1), curve_point(0.6, {0, 0, 0}, 1)}}};
  draw_curve(folder_, "zeros", figure);
  expect_drawn("zeros");
  figure.log_y = true;
  draw_curve(folder_, "log_zeros", figure);
  expect_drawn("log_zeros");
  figure.log_y = false;
  figure.series = {{"failed", {curve_point(0.5, {kNaN}, 1), curve_point(0.6, {kNaN, kNaN}, 1)}}};
  draw_curve(folder_, "failed", figure);
  expect_drawn("failed");
  EXPECT_TRUE(shows("failed", "n = 0 seeds a point; 3 runs without a value left out"));
  EXPECT_THROW(draw_curve(folder_, "none", {}), std::invalid_argument);
}

TEST_F(ExperimentFiguresTest, HeatmapWithBestAndTiedCells) {
  HeatmapFigure figure = heatmap(8, 6);
  figure.text = text_;
  figure.cells[3].mean = kNaN;
  figure.cells[3].failed = 50;
  figure.cells[3].n = 0;
  draw_heatmap(folder_, "heatmap", figure);
  expect_drawn("heatmap");
  EXPECT_TRUE(has_row("heatmap", "0.3,2,1,4,nan,0,50,0,nan,nan,ode"));
  EXPECT_TRUE(shows("heatmap", "n = 50 seeds a point; 50 runs without a value left out"));
  EXPECT_TRUE(shows("heatmap", "no run succeeded"));
  EXPECT_TRUE(shows("heatmap", "not separable"));
}

TEST_F(ExperimentFiguresTest, HeatmapsOfAllSizesAreDrawn) {
  for (const auto& [columns, rows] : {std::pair{1, 5}, {5, 2}, {1, 1}, {24, 20}}) {
    HeatmapFigure figure = heatmap(columns, rows);
    figure.text = text_;
    figure.log_colours = columns == 24;
    if (columns == 5) {
      for (HeatCell& cell : figure.cells) cell.mean = 2.0;
    }
    const std::string stem = "heatmap_" + std::to_string(columns);
    draw_heatmap(folder_, stem, figure);
    expect_drawn(stem);
  }
  HeatmapFigure failed = heatmap(2, 2);
  for (HeatCell& cell : failed.cells) cell.mean = kNaN;
  draw_heatmap(folder_, "failed", failed);
  expect_drawn("failed");
}

TEST_F(ExperimentFiguresTest, RiskMapOfTheFigureEight) {
  RiskMapFigure figure = risk_map(124);
  figure.text = text_;
  for (std::size_t i = 60; i < 66; ++i) {
    figure.points[i].mean = kNaN;
    figure.points[i].interval = {};
    figure.points[i].n = 40;
  }
  figure.failed = 60;
  draw_risk_map(folder_, "risk", figure);
  expect_drawn("risk");
  EXPECT_TRUE(has_row("risk", "0,0,0,7.5,6,9.75,50,0,ode"));
  EXPECT_TRUE(shows("risk", "n = 40–50 seeds a point; 60 runs without a value left out"));
  EXPECT_TRUE(shows("risk", ">start<"));
}

TEST_F(ExperimentFiguresTest, RiskMapsOfDegenerateDataAreDrawn) {
  RiskMapFigure figure = risk_map(62);
  figure.text = text_;
  figure.text.title = "A title";
  for (RiskPoint& p : figure.points) {
    p.mean = 2.0;
    p.interval = {};
    p.n = 1;
  }
  draw_risk_map(folder_, "constant", figure);
  expect_drawn("constant");
  figure.points.resize(1);
  figure.points[0].interval = {1.0, 3.0};
  draw_risk_map(folder_, "one_point", figure);
  expect_drawn("one_point");
  figure.points[0].mean = kNaN;
  figure.points[0].interval = {};
  draw_risk_map(folder_, "failed", figure);
  expect_drawn("failed");
}

// The bend of x = sin θ, y = sin θ cos θ is above half of its largest, 4.79, on both sides of each
// loop's end: around the times of its four maxima, 9.0 s and their mirror images.
TEST_F(ExperimentFiguresTest, TheFigureEightTurnsSharplyTwiceInEachLoop) {
  const std::vector<TimeSpan> turns = risk_map(620).turns;
  ASSERT_EQ(turns.size(), 4u);
  const std::vector<TimeSpan> expected{{6.6, 11.7}, {19.8, 24.9}, {38.0, 43.1}, {51.2, 56.3}};
  for (std::size_t i = 0; i < turns.size(); ++i) {
    EXPECT_NEAR(turns[i].start_s, expected[i].start_s, 0.15);
    EXPECT_NEAR(turns[i].end_s, expected[i].end_s, 0.15);
  }
  std::vector<RiskPoint> line(10);
  for (std::size_t i = 0; i < line.size(); ++i) line[i].x_m = static_cast<double>(i);
  EXPECT_TRUE(sharp_turns(line).empty());
  EXPECT_TRUE(sharp_turns({}).empty());
}

// Stored points are single precision: at rest and on a line, their rounding is no turn.
TEST_F(ExperimentFiguresTest, APathAtRestHasNoSharpTurns) {
  std::vector<RiskPoint> line;
  for (double t_s = 0.0; t_s < 10.0; t_s += 0.02) {
    const double s_m = 0.25 * t_s * t_s;
    RiskPoint point;
    point.time_s = t_s;
    point.x_m = static_cast<double>(static_cast<float>(-16.0 + 0.6 * s_m));
    point.y_m = static_cast<double>(static_cast<float>(3.1 + 0.8 * s_m));
    line.push_back(point);
  }
  EXPECT_TRUE(sharp_turns(line).empty());
}

}  // namespace
}  // namespace tether
