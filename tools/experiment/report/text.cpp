#include <fmt/format.h>

#include <fstream>
#include <sstream>

#include "common/base/share.hpp"
#include "common/version.hpp"
#include "tools/experiment/report/report.hpp"
#include "tools/experiment/sweep/progress.hpp"

namespace tether {
namespace {

constexpr char kStyle[] = R"(
:root { color-scheme: light dark; --paper: #fff; --ink: #222; --faint: #555; --line: #ccc; --code: #f4f4f4; --good: #00664b; --bad: #a03c00; --link: #0050a0 }
@media screen and (prefers-color-scheme: dark) {
  :root { --paper: #16202a; --ink: #e6e9ec; --faint: #b0b8c0; --line: #48545f; --code: #202d39; --good: #4fd0a5; --bad: #ff9a5c; --link: #7fc1ff }
}
body { font: 16px/1.5 sans-serif; background: var(--paper); color: var(--ink); max-width: 62rem; margin: 2rem auto; padding: 0 1rem }
a { color: var(--link) }
h1 { line-height: 1.2 } h2 { margin-top: 3rem }
img { width: 100%; max-height: 94vh; object-fit: contain; display: block; background: #fff }
table { border-collapse: collapse; font-size: .85rem; margin: 1rem 0 }
th, td { border-bottom: 1px solid var(--line); padding: .25rem .6rem; text-align: left; vertical-align: top }
td.number { text-align: right; white-space: nowrap }
.facts { color: var(--faint); font-size: .9rem }
.verdict { white-space: nowrap; font-weight: bold }
.reproduced { color: var(--good) } .not { color: var(--bad) } .undecided { color: var(--faint) }
pre { background: var(--code); padding: 1rem; overflow-x: auto; font-size: .8rem }
.scroll { overflow-x: auto }
select { max-width: 100% }
)";

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

std::string contents(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// Text as part of an address.
std::string percent_encoded(const std::string& text) {
  std::string url;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    const bool is_plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                          (c >= '0' && c <= '9') ||
                          std::string_view(" -_.,:;=/()").find(c) != std::string_view::npos;
    url += is_plain ? std::string(1, c) : fmt::format("%{:02X}", byte);
  }
  return url;
}

/// A file as the address of an image.
std::string data_url(const std::filesystem::path& svg) {
  return "data:image/svg+xml," + percent_encoded(contents(svg));
}

/// To a file in the report's folder.
std::string file_link(const std::string& name) {
  return fmt::format("<a href=\"./{}\">{}</a>", percent_encoded(name), escaped(name));
}

std::string with_reason(const Claim& claim) {
  return claim.ours + (claim.reason.empty() ? "" : ": " + claim.reason);
}

const char* class_of(Claim::Verdict verdict) {
  switch (verdict) {
    case Claim::Verdict::reproduced:
      return "reproduced";
    case Claim::Verdict::not_reproduced:
      return "not";
    case Claim::Verdict::undecided:
      break;
  }
  return "undecided";
}

std::string facts(const ReportSection& s) {
  std::string runs = fmt::format("{} runs", s.runs);
  if (!s.is_complete) runs += fmt::format(" of {} (not complete)", s.planned);
  if (s.failed > 0) runs += fmt::format(", {} failed", s.failed);
  if (!s.overrides.empty()) runs += ", with " + s.overrides;
  if (!s.is_common) runs += ", each with luck of its own, so that nothing is compared";
  return fmt::format("{}: {}, seeds {}, plant {}, tether {}, {} of wall time", s.name, runs,
                     s.seeds, s.plant, s.version, format_duration(s.wall_time_s));
}

/// Where the claims' numbers come from, and what to keep in mind.
std::string sources(const Report& report) {
  std::string plants, doubts;
  for (const ReportSection& s : report.sections) {
    if (plants.find(s.plant) == std::string::npos) plants += (plants.empty() ? "" : ", ") + s.plant;
    if (!s.is_complete) doubts += fmt::format(" {} is not complete.", s.name);
    if (!s.overrides.empty()) doubts += fmt::format(" {} was run with {}.", s.name, s.overrides);
  }
  return fmt::format(
      "Bragato et al., PIMRC 2025. Plant: {}. Judged by tether {}. Intervals hold 95 %; n is the "
      "number of runs.{}",
      plants, kVersion, doubts);
}

std::string html_rows(const std::vector<std::vector<std::string>>& rows, bool first_is_label) {
  std::string html = "<table>\n";
  for (const auto& row : rows) {
    html += "<tr>";
    for (const std::string& cell : row) {
      const bool is_label = first_is_label && &cell == &row.front();
      const char* tag = &row == &rows.front() ? "<th>"
                        : is_label            ? "<td>"
                                              : "<td class=\"number\">";
      html += tag + escaped(cell);
    }
    html += "</tr>\n";
  }
  return html + "</table>";
}

/// JSON within a script: nothing in it may end the script, or, as "<!--" with "<script" does, keep
/// it from ending. JSON has "<" in strings only.
std::string script_data(const std::string& json) {
  std::string data;
  for (const char c : json) data += c == '<' ? std::string("\\u003c") : std::string(1, c);
  return data;
}

std::string html_of(const ReportSection& s, const std::filesystem::path& folder) {
  std::string html = fmt::format("<h2 id=\"{0}\">{1}</h2>\n", escaped(s.name), escaped(s.title));
  if (!s.figure.empty()) {
    html += fmt::format("<img alt=\"{}\" src=\"{}\">\n", escaped(s.title),
                        data_url(folder / (s.figure + ".svg")));
  }
  if (!s.chart.empty()) {
    html += fmt::format(
        "<details class=\"chart\"><summary>Explore: values, single series, the runs behind a "
        "point</summary><canvas role=\"img\" aria-label=\"{}\"></canvas><div class=\"runs\">A "
        "point's "
        "click shows its runs.</div><script type=\"application/json\">{}</script></details>\n",
        escaped(s.title), script_data(s.chart));
  }
  html += fmt::format("<p class=\"facts\">{}", escaped(facts(s)));
  if (!s.figure.empty()) {
    html += ". Data, script and print files:";
    const char* before = " ";
    for (const char* kind : {".csv", ".gp", ".pdf", ".png", ".svg", ".tex"}) {
      if (!std::filesystem::exists(folder / (s.figure + kind))) continue;
      html += before + file_link(s.figure + kind);
      before = ", ";
    }
  }
  html += "</p>\n";
  for (std::size_t i = 0; i < s.tables.size(); ++i) {
    html +=
        fmt::format("<h3>{}</h3>\n<div class=\"scroll\">{}</div>\n<p class=\"facts\">{}. {}</p>\n",
                    escaped(s.tables[i].title), html_rows(s.tables[i].rows, true),
                    escaped(s.tables[i].note), file_link(s.table_files[i]));
  }
  html +=
      "<details><summary>All numbers</summary><div class=\"scroll\">" + html_rows(s.table, false);
  return html + fmt::format(
                    "\n</div></details>\n<details><summary>Scenario (of the first "
                    "combination)</summary><pre>{}</pre></details>\n",
                    escaped(s.scenario));
}

std::string markdown_cell(std::string text) {
  for (std::size_t i = text.find('|'); i != std::string::npos; i = text.find('|', i + 2)) {
    text.insert(i, "\\");
  }
  return text;
}

std::string markdown_row(const std::vector<std::string>& cells) {
  std::string row = "|";
  for (const std::string& cell : cells) row += " " + markdown_cell(cell) + " |";
  return row + "\n";
}

std::string markdown_table(const std::vector<std::vector<std::string>>& rows) {
  std::string text;
  for (const auto& row : rows) {
    text += markdown_row(row);
    if (&row != &rows.front()) continue;
    text += "|";
    for (std::size_t i = 0; i < row.size(); ++i) text += "-|";
    text += "\n";
  }
  return text;
}

}  // namespace

std::string to_html(const Report& report, const std::filesystem::path& folder) {
  std::string html = fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, "
      "initial-scale=1\">\n<title>{0}</title>\n"
      "<style>{1}</style></head><body>\n<h1>{0}</h1>\n",
      escaped(report.title), kStyle);
  if (!report.claims.empty()) {
    html +=
        "<h2>What the paper says, and what came out</h2>\n<p>" + escaped(sources(report)) +
        "</p>\n<table id=\"claims\"><tr><th>Figure</th><th>Paper</th><th>Here</th><th>Verdict</th>"
        "</tr>\n";
    for (const Claim& claim : report.claims) {
      html += fmt::format(
          "<tr><td>{}</td><td>{}</td><td>{}</td><td class=\"verdict {}\">{}</td></tr>\n",
          escaped(claim.figure), escaped(claim.paper), escaped(with_reason(claim)),
          class_of(claim.verdict), to_text(claim.verdict));
    }
    html += "</table>\n";
  }
  bool has_charts = false;
  for (const ReportSection& section : report.sections) {
    html += html_of(section, folder);
    has_charts = has_charts || !section.chart.empty();
  }
  if (has_charts) {
    for (const char* script : {"report/chart.min.js", "report/page/report.js"}) {
      html += fmt::format("<script>{}</script>\n", contents(shared_file(script)));
    }
  }
  return html + "</body></html>\n";
}

std::string to_markdown(const Report& report) {
  std::string text = fmt::format("# {}\n", report.title);
  if (!report.claims.empty()) {
    text += "\n## What the paper says, and what came out\n\n" + sources(report) + "\n\n";
    std::vector<std::vector<std::string>> rows{{"Figure", "Paper", "Here", "Verdict"}};
    for (const Claim& claim : report.claims) {
      rows.push_back({claim.figure, claim.paper, with_reason(claim), to_text(claim.verdict)});
    }
    text += markdown_table(rows);
  }
  for (const ReportSection& s : report.sections) {
    text += fmt::format("\n## {}\n\n", s.title);
    if (!s.figure.empty()) text += fmt::format("![{}]({}.png)\n\n", s.title, s.figure);
    text += facts(s) + "\n\n";
    text += fmt::format(
        "<details><summary>Scenario (of the first combination)</summary>\n\n```toml\n{}```\n\n"
        "</details>\n\n",
        s.scenario);
    for (std::size_t i = 0; i < s.tables.size(); ++i) {
      text += fmt::format("### {}\n\n{}\n{} ({}).\n\n", s.tables[i].title,
                          markdown_table(s.tables[i].rows), s.tables[i].note, s.table_files[i]);
    }
    if (!s.tables.empty()) text += "### All combinations\n\n";
    text += markdown_table(s.table);
  }
  return text;
}

}  // namespace tether
