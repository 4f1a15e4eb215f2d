#include <gtest/gtest.h>

#include <filesystem>
#include <limits>
#include <sstream>
#include <string>

#include "tests/support/folder.hpp"
#include "tests/support/tex.hpp"
#include "tests/tools/experiment/nan.hpp"
#include "tools/experiment/figures/figures.hpp"

namespace tether {
namespace {

PlottedPoint point(double x, double y) {
  const std::vector<double> runs{0.9 * y, y, 1.1 * y};
  const Summary s = summarize(runs, kConfidence, 1);
  return {x, runs, s.mean, s.mean_interval, 0, {0.9 * x, 1.1 * x}};
}

// The second of four is beaten by the first in both; the others are what it costs to be better.
TEST(ParetoFigure, OfTwoSeriesHasTheirFront) {
  const test::Folder folder;
  ParetoFigure figure;
  figure.text = {"", "ode", "paper"};
  figure.x_label = "busy";
  figure.series = {{"plans", {point(0.1, 0.04), point(0.2, 0.06)}},
                   {"PID, changed", {point(0.2, 0.02), point(0.3, 0.01), point(kNaN, 0.001)}}};
  draw_pareto(folder.path, "pareto", figure);
  std::string front;
  std::istringstream lines(test::contents(folder.path / "pareto.csv"));
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("0,")) front += line.substr(2, line.find(',', 2) - 2) + " ";
  }
  EXPECT_EQ(front, "0.1 0.2 0.3 ");
  EXPECT_NE(test::contents(folder.path / "pareto.svg").find("PID, changed"), std::string::npos);
  test::expect_tex(test::contents(folder.path / "pareto.tex"));
  EXPECT_EQ(test::contents(folder.path / "pareto.pdf").substr(0, 5), "%PDF-");
  EXPECT_GT(test::contents(folder.path / "pareto.png").size(), 5000U);
}

TEST(ParetoFigure, NeedsAPoint) {
  const test::Folder folder;
  ParetoFigure figure;
  figure.series = {{"nothing", {point(kNaN, 1.0)}}};
  EXPECT_THROW(draw_pareto(folder.path, "none", figure), std::invalid_argument);
}

class CurveFigureTest : public ::testing::Test {
 protected:
  static PlottedPoint curve_point(double x, const std::vector<double>& runs, std::uint64_t seed) {
    const Summary s = summarize(runs, kConfidence, seed);
    return {x, runs, s.mean, s.mean_interval};
  }
  std::string contents(const std::string& name) const { return test::contents(folder_ / name); }
  bool shows(const std::string& stem, const std::string& text) const {
    return contents(stem + ".svg").find(text) != std::string::npos;
  }
  bool has_row(const std::string& stem, const std::string& row) const {
    return contents(stem + ".csv").find("\n" + row + "\n") != std::string::npos;
  }

  const test::Folder own_;
  const std::filesystem::path folder_ = own_.path;
  FigureText text_{"", "ode", "paper"};
};

TEST_F(CurveFigureTest, EqualRunsAreOneDotAndNamedAsEqual) {
  CurveFigure figure{.text = text_, .x_label = "δ [ms]", .names = {}, .series = {}};
  figure.series = {{"", {curve_point(0.0, {1.5, 1.5, 1.5}, 1), curve_point(100.0, {2, 2, 2}, 1)}}};
  draw_curve(folder_, "equal", figure);
  test::expect_tex(contents("equal.tex"));
  EXPECT_TRUE(has_row("equal", "1,run,100,100,2,,,,,,ode"));
  EXPECT_TRUE(shows("equal", "all of them equal"));
  EXPECT_TRUE(shows("equal", "every run"));
  EXPECT_FALSE(shows("equal", "interval")) << "there is none";
  figure.series.push_back(figure.series[0]);
  draw_curve(folder_, "equal", figure);
  EXPECT_TRUE(shows("equal", "all of them equal"));
  EXPECT_FALSE(shows("equal", "interval")) << "nor of two";
  figure.series.pop_back();
  figure.series[0].points[1] = curve_point(100.0, {2, 2.5, 2}, 1);
  draw_curve(folder_, "equal", figure);
  EXPECT_FALSE(has_row("equal", "1,run,100,100,2,,,,,,ode")) << "else dots would hide each other";
  EXPECT_TRUE(has_row("equal", "1,run,0,0,1.5,,,,,,ode"));
  EXPECT_FALSE(shows("equal", "all of them equal"));
}

TEST_F(CurveFigureTest, CurveOverNamesHasBarsSideBySideAndTheNamesBelow) {
  CurveFigure figure{.text = text_, .x_label = "trace", .names = {}, .series = {}};
  figure.names = {"office_100%", "hall & yard", "a warehouse with a long name"};
  for (const std::string law : {"PID", "plans"}) {
    CurveSeries one{law, {}};
    for (int i = 1; i <= 3; ++i) {
      one.points.push_back(curve_point(i, {1.0 * i, 1.2 * i, 1.3 * i, 0.9 * i}, 1));
    }
    figure.series.push_back(one);
  }
  draw_curve(folder_, "names", figure);
  test::expect_tex(contents("names.tex"));
  for (const char* name : {"office_100%", "hall &amp; yard", "a warehouse with a l…"}) {
    EXPECT_TRUE(shows("names", name)) << name;
  }
  EXPECT_NE(contents("names.tex").find("office\\_100\\%"), std::string::npos);
  EXPECT_NE(contents("names.csv").find("1,mean,1,0.875,"), std::string::npos);
  EXPECT_NE(contents("names.csv").find("2,mean,1,1.125,"), std::string::npos);
  EXPECT_NE(contents("names.csv").find(",plans,a warehouse with a long name,ode"),
            std::string::npos);
}

}  // namespace
}  // namespace tether
