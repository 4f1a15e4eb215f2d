#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "tools/experiment/figures/figures.hpp"

namespace tether {

/// Colours of the series, in turn: Okabe and Ito's, which the colour-blind can tell apart.
inline constexpr std::array kSeriesColours{"0072b2", "d55e00", "009e73", "cc79a7",
                                           "e69f00", "56b4e9", "000000"};

/// Common parts of the figures' scripts. A script is: variables, kPrologue, the figure's own
/// commands within kEachFormat and kEndFormat, which are run once a format.

/// A literal for gnuplot, in single quotes: nothing in it is expanded.
std::string gnuplot_text(const std::string& text);
/// A cell of a .csv, in quotes where it needs them; control characters become blanks.
std::string csv_cell(const std::string& text);
/// About how wide the text is in a figure: its number of characters (not of bytes, in UTF-8).
double text_cm(const std::string& text);

/// "n = 50 seeds a point", "n = 20–50 seeds a point"; and how many have no value, if any:
/// they failed, or the metric is not defined there (0 / 0).
std::string seeds_note(std::size_t least, std::size_t most, std::size_t without_value);

/// "; ×: vehicles were lost (at most 6.7 %) …" if some were at any point; else nothing.
std::string losses_note(const std::vector<CurveSeries>& all);

/// The least and most of what was added, if anything.
struct LeastMost {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();
  void add(double value) {  // NaN changes nothing
    if (value < low) low = value;
    if (value > high) high = value;
  }
  bool empty() const { return low > high; }
};

/// Symbol of a legend in front of a name, with its gnuplot properties.
struct LegendEntry {
  enum class Sample { line, point, linespoint, area };
  Sample sample = Sample::line;
  std::string style;
  std::string name;
};

/// Frame around the axes, drawn without gnuplot's own means: title, legend (gnuplot's breaks a
/// column too early), caption. The lines below are the note, then plant and scenario.
class FigureFrame {
 public:
  enum class Legend { above, below };

  FigureFrame(const FigureText& text, const std::string& note, std::vector<LegendEntry> legend,
              Legend place);

  /// How much of the figure's height it takes.
  double top_cm() const;
  double bottom_cm() const;

  /// Variables that all scripts need. The commands in `decoration` set labels, arrows and objects,
  /// numbered from 1001 on.
  std::string variables(const std::string& stem, double height_cm) const;

 private:
  std::string texts() const;
  std::string caption() const;
  std::string legend(double height_cm) const;

  FigureText text_;
  std::vector<std::string> lines_;              ///< below
  std::vector<std::vector<LegendEntry>> rows_;  ///< rows of the legend
  bool above_;
};

/// Writes data and script and runs it.
void draw_figure(const std::filesystem::path& folder, const std::string& stem,
                 const std::string& csv, const FigureText& text, const std::string& variables,
                 const char* commands);

}  // namespace tether
