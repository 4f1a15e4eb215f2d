#include "tools/netem/import.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/base/errors.hpp"
#include "netem/models/trace.hpp"

namespace tether {
namespace {

constexpr double kGapIsLonger = 10.0;  // times the median from row to row

double median_step_s(const std::vector<Imported::Row>& rows) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < rows.size(); ++i)
    steps.push_back(rows[i].time_s - rows[i - 1].time_s);
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
}

/// Refuses values that a trace cannot hold.
void check_bounds(const Imported& imported, const std::string& name) {
  if (imported.rows.empty()) return;
  const double span_s = imported.rows.back().time_s - imported.rows.front().time_s;
  if (span_s > Trace::kLongest_s) {
    throw UsageError(fmt::format("{}: its times are {:.3g} s apart; a trace has {:g} s at most",
                                 name, span_s, Trace::kLongest_s));
  }
  for (const Imported::Row& row : imported.rows) {
    if (row.delay_ms.value_or(0.0) <= Trace::kLongestDelay_ms) continue;
    throw UsageError(fmt::format("{}: a delay is {:.3g} ms; a trace has {:g} ms at most", name,
                                 *row.delay_ms, Trace::kLongestDelay_ms));
  }
}

}  // namespace

void apply(const GapRule& rule, Imported& imported, const std::string& name) {
  check_bounds(imported, name);
  if (imported.rows.size() == 1) {
    imported.notes.push_back("a single row: it holds for as long as the trace is used");
  }
  if (imported.rows.size() < 2) return;
  const double step_s = median_step_s(imported.rows);
  const double limit_s = rule.longer_than_s > 0.0 ? rule.longer_than_s : kGapIsLonger * step_s;
  std::vector<Imported::Row> rows;
  std::size_t gaps = 0;
  double longest_s = 0.0, longest_at_s = 0.0;
  for (std::size_t i = 0; i < imported.rows.size(); ++i) {
    rows.push_back(imported.rows[i]);
    if (i + 1 == imported.rows.size()) break;
    const double gap_s = imported.rows[i + 1].time_s - imported.rows[i].time_s;
    if (gap_s <= limit_s) continue;
    ++gaps;
    if (gap_s > longest_s) longest_at_s = imported.rows[i].time_s;
    longest_s = std::max(longest_s, gap_s);
    if (rule.meaning == GapRule::Meaning::lost) {
      rows.push_back({imported.rows[i].time_s + std::min(step_s, 0.5 * gap_s), std::nullopt, 0.0});
    }
  }
  if (gaps == 0) return;
  const std::string what =
      fmt::format("{} gap{} longer than {:g} s, the longest of {:g} s at {:g} s", gaps,
                  gaps > 1 ? "s" : "", limit_s, longest_s, longest_at_s);
  if (rule.meaning == GapRule::Meaning::refuse) throw UsageError(fmt::format("{}: {}", name, what));
  const bool lost = rule.meaning == GapRule::Meaning::lost;
  imported.notes.push_back(what + (lost ? ": everything is lost there"
                                        : ": the row before holds (--gaps lost: nothing passes)"));
  imported.rows = std::move(rows);
}

std::string to_trace_csv(const Imported& imported, const std::string& source) {
  std::string text = fmt::format("# {}\n", source);
  for (const std::string& note : imported.notes) text += fmt::format("# {}\n", note);
  text += fmt::format("time_s{},{}\n", imported.has_delays ? ",delay_ms" : "",
                      imported.of_fates ? "lost" : "prr");
  for (const Imported::Row& row : imported.rows) {
    text += fmt::format("{:.9f}", row.time_s);
    if (imported.has_delays) text += row.delay_ms ? fmt::format(",{:.9g}", *row.delay_ms) : ",";
    text += imported.of_fates ? fmt::format(",{}\n", row.prr > 0.5 ? 0 : 1)
                              : fmt::format(",{:.9g}\n", row.prr);
  }
  return text;
}

std::string format_of_measurement(const std::string& text) {
  const std::size_t begin = std::min(text.find_first_not_of(" \t\r\n"), text.size());
  const auto has = [&](const char* what) { return text.find(what) < 4096; };
  if (begin < text.size() && text[begin] == '{') return "iperf3";
  if (has("[ ID] Interval") || has("[ ID][Role]") || has("Connecting to host") ||
      has("Server listening") || has("Accepted connection"))
    return "iperf3";
  if (has("PING ") || has("icmp_seq=") || has("bytes from ")) return "ping";
  if (has("TTL=") || has("Reply from ") || has("Request timed out")) return "ping";  // Windows'
  return "csv";
}

}  // namespace tether
