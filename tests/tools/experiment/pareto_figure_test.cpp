#include <gtest/gtest.h>

#include <filesystem>
#include <limits>
#include <sstream>
#include <string>

#include "tests/support/folder.hpp"
#include "tools/experiment/figures/figures.hpp"

namespace tether {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

PlottedPoint point(double x, double y) {
  const std::vector<double> runs{0.9 * y, y, 1.1 * y};
  const Summary s = summarize(runs, kConfidence, 1);
  return {x, runs, s.mean, s.mean_interval, 0, {0.9 * x, 1.1 * x}};
}

// The second of four is beaten by the first in both; the others are what it costs to be better.
TEST(ParetoFigure, OfTwoSeriesHasTheirFront) {
  const testing::Folder folder;
  ParetoFigure figure;
  figure.text = {"", "ode", "paper.toml"};
  figure.x_label = "busy";
  figure.series = {{"plans", {point(0.1, 0.04), point(0.2, 0.06)}},
                   {"PID, changed", {point(0.2, 0.02), point(0.3, 0.01), point(kNan, 0.001)}}};
  draw_pareto(folder.path, "pareto", figure);
  std::string front;
  std::istringstream lines(testing::contents(folder.path / "pareto.csv"));
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("0,")) front += line.substr(2, line.find(',', 2) - 2) + " ";
  }
  EXPECT_EQ(front, "0.1 0.2 0.3 ");
  EXPECT_NE(testing::contents(folder.path / "pareto.svg").find("PID, changed"), std::string::npos);
  EXPECT_EQ(testing::contents(folder.path / "pareto.pdf").substr(0, 5), "%PDF-");
  EXPECT_GT(testing::contents(folder.path / "pareto.png").size(), 5000U);
}

TEST(ParetoFigure, NeedsAPoint) {
  const testing::Folder folder;
  ParetoFigure figure;
  figure.series = {{"nothing", {point(kNan, 1.0)}}};
  EXPECT_THROW(draw_pareto(folder.path, "none", figure), std::invalid_argument);
}

}  // namespace
}  // namespace tether
