#include "tools/experiment/figures/figure_script.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <sstream>

#include "tools/base/gnuplot.hpp"
#include "tools/base/replacing_output.hpp"

namespace tether {
namespace {

// Sizes for a wide font of 7 pt.
constexpr double kCharacter_cm = 0.13, kLine_cm = 0.31, kLegendRow_cm = 0.35, kTitle_cm = 0.5;
constexpr double kSample_cm = 0.55, kSpace_cm = 0.12, kBetween_cm = 0.35;

// Sizes: an SVG's pixel is 1/96 inch; the PNG has 300 a inch. Fonts are 7.5 pt, captions 7 pt.
constexpr char kPrologue[] = R"gnuplot(
set encoding utf8
set datafile separator ","
set border lc rgb "#444444"
set tics nomirror out scale 0.6
unset key
set colorbox user noborder
set palette defined (0.00 "#00224e", 0.10 "#0a2f6e", 0.20 "#31446b", 0.30 "#4a566c", \
  0.40 "#61686f", 0.50 "#7a7b78", 0.60 "#948e77", 0.70 "#afa371", 0.80 "#cbb966", \
  0.90 "#e7d054", 1.00 "#fee838")  # cividis
font = "Helvetica"
terminal_svg = sprintf('set terminal svg size %.0f,%.0f font "%s,10" background "white" lw 1.2', \
  width_cm / 2.54 * 96, height_cm / 2.54 * 96, font)
terminal_pdf = sprintf('set terminal pdfcairo size %gcm,%gcm font "%s,7.5" fontscale 1 lw 1.6', \
  width_cm, height_cm, font)
terminal_png = sprintf('set terminal pngcairo size %.0f,%.0f font "%s,7.5" fontscale 3.125 ' \
  . 'lw 2.6 pointscale 2.6', width_cm / 2.54 * 300, height_cm / 2.54 * 300, font)
terminal_tex = sprintf('set terminal tikz size %gcm,%gcm font ",7.5" fontscale 1 linewidth 1.2', \
  width_cm, height_cm)
# What TeX would take for a command, or has no letter for.
replaced(s, from, to) = strstrt(s, from) == 0 ? s : \
  s[1 : strstrt(s, from) - 1] . to . replaced(s[strstrt(s, from) + strlen(from) : *], from, to)
tex_letters = "\\ \\textbackslash{} % \\% & \\& # \\# $ \\$ _ \\_ ^ \\^{} ε $\\varepsilon$ " \
  . "δ $\\delta$ τ $\\tau$ × $\\times$ ± $\\pm$ – --"
tex_from(s, i) = i > words(tex_letters) ? s : \
  tex_from(replaced(s, word(tex_letters, i), word(tex_letters, i + 1)), i + 2)
tex(s) = tex_from(s, 1)
formats = strstrt(GPVAL_TERMINALS, "tikz") > 0 ? "svg pdf png tex" : "svg pdf png"

do for [format in formats] {
  if (format eq "tex") { eval texts_for_tex }
  eval value("terminal_" . format)
  set output stem . "." . format
  eval decoration
)gnuplot";

constexpr char kEpilogue[] = R"gnuplot(
  unset label
  unset arrow
  unset object
  set output
}
)gnuplot";

double entry_cm(const LegendEntry& entry) {
  return kSample_cm + kSpace_cm + 1.07 * text_cm(entry.name);
}

double row_cm(const std::vector<LegendEntry>& row) {
  double width = -kBetween_cm;
  for (const LegendEntry& entry : row) width += entry_cm(entry) + kBetween_cm;
  return width;
}

// Rows of the legend, each with as many entries as fit.
std::vector<std::vector<LegendEntry>> legend_rows(const std::vector<LegendEntry>& entries,
                                                  double width_cm) {
  std::vector<std::vector<LegendEntry>> rows;
  for (const LegendEntry& entry : entries) {
    if (rows.empty() || row_cm(rows.back()) + kBetween_cm + entry_cm(entry) > width_cm - 0.3) {
      rows.emplace_back();
    }
    rows.back().push_back(entry);
  }
  return rows;
}

std::vector<std::string> caption_lines(const FigureText& text, const std::string& note) {
  std::string origin;
  if (!text.plant.empty()) origin = "plant: " + text.plant;
  if (!text.experiment.empty()) {
    origin += (origin.empty() ? "" : ", ") + ("experiment: " + text.experiment);
  }
  std::vector<std::string> lines;
  for (const std::string& part : {note, origin}) {
    std::istringstream words(part);
    std::string word, line;
    while (words >> word) {
      if (!line.empty() && text_cm(line) + text_cm(word) > text.width_cm - 0.4) {
        lines.push_back(line);
        line.clear();
      }
      if (!line.empty()) line += " ";
      line += word;
    }
    if (!line.empty()) lines.push_back(line);
  }
  return lines;
}

std::string with_last_column(const std::string& csv, const std::string& head,
                             const std::string& value) {
  if (value.empty()) return csv;
  std::istringstream in(csv);
  std::string out, row;
  while (std::getline(in, row)) out += row + "," + csv_cell(out.empty() ? head : value) + "\n";
  return out;
}

}  // namespace

double text_cm(const std::string& text) {
  const auto starts = std::count_if(text.begin(), text.end(), [](char c) {
    return (static_cast<unsigned char>(c) & 0xc0) != 0x80;  // not within a character of UTF-8
  });
  return kCharacter_cm * static_cast<double>(starts);
}

std::string gnuplot_text(const std::string& text) {
  std::string literal = "'";
  for (const char c : text) {
    if (c == '\'') literal += '\'';
    literal += static_cast<unsigned char>(c) < ' ' ? ' ' : c;
  }
  return literal + "'";
}

std::string csv_cell(const std::string& text) {
  const auto is_plain = [](char c) {
    return static_cast<unsigned char>(c) >= ' ' && c != ',' && c != '"';
  };
  if (std::all_of(text.begin(), text.end(), is_plain)) return text;
  std::string cell = "\"";
  for (const char c : text) {
    if (c == '"') cell += '"';
    cell += static_cast<unsigned char>(c) < ' ' ? ' ' : c;
  }
  return cell + "\"";
}

std::string seeds_note(std::size_t least, std::size_t most, std::size_t without_value) {
  std::string note =
      least == most ? fmt::format("n = {}", least) : fmt::format("n = {}–{}", least, most);
  note += most == 1 ? " seed a point" : " seeds a point";
  if (without_value > 0) {
    note += fmt::format("; {} {} without a value left out", without_value,
                        without_value == 1 ? "run" : "runs");
  }
  return note;
}

std::string losses_note(const std::vector<CurveSeries>& all) {
  double most = 0.0;
  for (const CurveSeries& series : all) {
    for (const PlottedPoint& p : series.points) {
      if (p.lost == 0) continue;
      most = std::max(most, static_cast<double>(p.lost) / static_cast<double>(p.runs.size()));
    }
  }
  if (most == 0.0) return "";
  return fmt::format(
      "; ×: up to {:.0f} % of the vehicles were lost, the mean is of these and the others",
      100.0 * most);
}

FigureFrame::FigureFrame(const FigureText& text, const std::string& note,
                         std::vector<LegendEntry> legend, Legend place)
    : text_(text),
      lines_(caption_lines(text, note)),
      rows_(legend_rows(legend, text.width_cm)),
      above_(place == Legend::above) {}

double FigureFrame::top_cm() const {
  return 0.2 + (text_.title.empty() ? 0.0 : kTitle_cm) +
         (above_ ? kLegendRow_cm * static_cast<double>(rows_.size()) : 0.0);
}

double FigureFrame::bottom_cm() const {
  return 0.05 + kLine_cm * static_cast<double>(lines_.size()) +
         (above_ ? 0.0 : kLegendRow_cm * static_cast<double>(rows_.size()));
}

std::string FigureFrame::variables(const std::string& stem, double height_cm) const {
  std::string commands;
  if (!text_.title.empty()) {
    commands += "set label 1001 title_text at screen 0.5, 1 - 0.27 / height_cm center noenhanced; ";
  }
  commands += caption() + legend(height_cm);
  const std::string own = fmt::format(
      "stem = {}\ndata = {}\ntitle_text = {}\nwidth_cm = {:.3f}\nheight_cm = {:.3f}\n"
      "top_cm = {:.3f}\nbottom_cm = {:.3f}\ndecoration = {}\n",
      gnuplot_text(stem), gnuplot_text(stem + ".csv"), gnuplot_text(text_.title), text_.width_cm,
      height_cm, top_cm(), bottom_cm(), gnuplot_text(commands));
  return texts() + own;
}

// Variables of their own, because gnuplot 5.4 misreads quotes within quotes within quotes.
std::string FigureFrame::texts() const {
  std::string variables;
  for (std::size_t i = 0; i < lines_.size(); ++i) {
    variables += fmt::format("text_{} = {}\n", 1002 + i, gnuplot_text(lines_[i]));
  }
  int tag = 1020;
  for (const std::vector<LegendEntry>& row : rows_) {
    for (const LegendEntry& entry : row) {
      variables += fmt::format("text_{} = {}\n", tag + 2, gnuplot_text(entry.name));
      tag += 3;
    }
  }
  return variables;
}

std::string FigureFrame::caption() const {
  std::string commands;
  for (std::size_t i = 0; i < lines_.size(); ++i) {
    const double y_cm = 0.17 + kLine_cm * static_cast<double>(lines_.size() - 1 - i);
    commands += fmt::format(
        "set label {0} text_{0} at screen 0.1 / width_cm, {1:.3f} / height_cm left noenhanced "
        "font \",7\" tc rgb \"#444444\"; ",
        1002 + i, y_cm);
  }
  return commands;
}

std::string FigureFrame::legend(double height_cm) const {
  std::string commands;
  int tag = 1020;
  double y_cm = above_
                    ? height_cm - top_cm() + 0.1 + kLegendRow_cm * static_cast<double>(rows_.size())
                    : bottom_cm();
  for (const std::vector<LegendEntry>& row : rows_) {
    double x_cm = 0.5 * (text_.width_cm - row_cm(row));
    y_cm -= kLegendRow_cm;
    for (const LegendEntry& entry : row) {
      using Sample = LegendEntry::Sample;
      const auto at = [](double x, double y) {
        return fmt::format("screen {:.3f} / width_cm, screen {:.3f} / height_cm", x, y);
      };
      const double right_cm = x_cm + kSample_cm, middle_cm = y_cm + 0.5 * kLegendRow_cm;
      if (entry.sample == Sample::line || entry.sample == Sample::linespoint) {
        commands += fmt::format("set arrow {} from {} to {} nohead {}; ", tag, at(x_cm, middle_cm),
                                at(right_cm, middle_cm), entry.style);
      }
      if (entry.sample == Sample::point || entry.sample == Sample::linespoint) {
        commands += fmt::format("set label {} \"\" at {} point pt 7 {}{}; ", tag + 1,
                                at(x_cm + 0.5 * kSample_cm, middle_cm), entry.style,
                                entry.sample == Sample::linespoint ? " ps 0.45" : "");
      }
      if (entry.sample == Sample::area) {
        commands +=
            fmt::format("set object {} rectangle from {} to {} {}; ", tag,
                        at(x_cm, middle_cm - 0.1), at(right_cm, middle_cm + 0.1), entry.style);
      }
      commands += fmt::format("set label {0} text_{0} at {1} left noenhanced; ", tag + 2,
                              at(right_cm + kSpace_cm, middle_cm));
      tag += 3;
      x_cm += entry_cm(entry) + kBetween_cm;
    }
  }
  return commands;
}

namespace {

/// Commands that have all texts among a script's variables as TeX needs them.
std::string texts_for_tex(const std::string& variables) {
  std::istringstream in(variables);
  std::string commands, line;
  while (std::getline(in, line)) {
    const std::string name = line.substr(0, line.find(" = '"));
    const bool is_text = name.starts_with("text_") || name.starts_with("titles[") ||
                         name == "title_text" || name.ends_with("_label");
    if (is_text && name != line) commands += fmt::format("{0} = tex({0}); ", name);
  }
  return "texts_for_tex = " + gnuplot_text(commands) + "\n";
}

}  // namespace

void draw_figure(const std::filesystem::path& folder, const std::string& stem,
                 const std::string& csv, const FigureText& text, const std::string& variables,
                 const char* commands) {
  write_file(folder / (stem + ".csv"), with_last_column(csv, "plant", text.plant));
  run_gnuplot(folder, stem + ".gp",
              variables + texts_for_tex(variables) + kPrologue + commands + kEpilogue);
}

}  // namespace tether
