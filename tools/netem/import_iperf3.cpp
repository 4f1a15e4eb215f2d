#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string_view>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "tools/base/json.hpp"
#include "tools/netem/import.hpp"

namespace tether {
namespace {

using Json = nlohmann::json;

using Rows = std::vector<Imported::Row>;

constexpr char kNoReceiver[] =
    "losses by interval are wanted, as the receiver of UDP reports them (iperf3 -c … -u with "
    "--get-server-output, or what iperf3 -s writes; not --bidir), or round trips of a sender of "
    "TCP "
    "(iperf3 -c … --json)";

void add_row(Rows& rows, Imported::Row row) {
  if (!rows.empty() && row.time_s <= rows.back().time_s) return;  // the summary
  rows.push_back(row);
}

/// iperf3 subtracts packets that arrive after they counted as lost from an interval's losses, which
/// may then be below 0.
void add_udp(Rows& rows, double start_s, double packets, double lost) {
  if (packets > 0.0) add_row(rows, {start_s, std::nullopt, std::min(1.0, 1.0 - lost / packets)});
}

/// Text report of one side of a test. Senders' intervals, and TCP's, have no losses.
class Report {
 public:
  explicit Report(int first_line) : first_line_(first_line) {}

  /// "[  5]   0.00-1.00   sec   128 KBytes  1.05 Mbits/sec  0.012 ms  3/90 (3.3%)"; other lines do
  /// not count.
  void add(int line_number, const std::string& line) {
    std::istringstream words(line.substr(std::min(line.find(']'), line.size() - 1) + 1));
    std::string span, unit, word;
    words >> span >> unit;
    const std::size_t dash = span.find('-');
    if (unit != "sec" || dash == std::string::npos) return;
    const auto start_s = to_number<double>(std::string_view(span).substr(0, dash));
    std::optional<double> lost, packets;
    while (words >> word) {
      if (word == "sender" || word == "receiver" || word == "(omitted)") return;
      const std::size_t slash = word.find('/');
      if (slash == std::string::npos) continue;
      lost = to_number<double>(std::string_view(word).substr(0, slash));
      packets = to_number<double>(std::string_view(word).substr(slash + 1));
    }
    if (!start_s) return;
    if (!lost || !packets) {
      if (lossless_line_ == 0) lossless_line_ = line_number;
      lossless_at_s_ = *start_s;
    } else if (lossless_line_ == 0 ||
               *start_s > lossless_at_s_) {  // old ones do not mark summaries
      add_udp(line.find("[SUM]") != std::string::npos ? sums_ : streams_, *start_s, *packets,
              *lost);
    }
  }

  int first_line() const { return first_line_; }
  int lossless_line() const {
    return lossless_line_;
  }  ///< the first interval without losses; 0: none
  /// Rows of the stream, or the sum of several.
  const Rows& rows() const { return sums_.empty() ? streams_ : sums_; }

 private:
  int first_line_;
  int lossless_line_ = 0;
  double lossless_at_s_ = 0.0;
  Rows streams_, sums_;
};

/// The receiver's report among those of a text; `name` stands for it in errors.
Rows from_text(const std::string& text, const std::string& name) {
  std::vector<Report> reports(1, Report(1));
  std::istringstream lines(text);
  int line_number = 0;
  for (std::string line; std::getline(lines, line);) {
    ++line_number;
    const auto has = [&](const char* what) { return line.find(what) != std::string::npos; };
    if (has("Accepted connection") || has("Server output:")) reports.emplace_back(line_number);
    if (!line.empty()) reports.back().add(line_number, line);
  }
  const Report* receiver = nullptr;
  int lossless_line = 0;
  for (const Report& report : reports) {
    if (lossless_line == 0) lossless_line = report.lossless_line();
    if (report.rows().empty()) continue;
    if (receiver != nullptr) {
      throw UsageError(fmt::format("{}:{}: a second report with losses begins: a trace is of one",
                                   name, report.first_line()));
    }
    receiver = &report;
  }
  if (receiver != nullptr) return receiver->rows();
  if (lossless_line == 0) throw UsageError(fmt::format("{}: {}", name, kNoReceiver));
  throw UsageError(
      fmt::format("{}:{}: an interval without losses; {}", name, lossless_line, kNoReceiver));
}

/// The intervals of a report in JSON; none if they have neither losses nor round trips.
Rows intervals(const Json& report) {
  Rows rows;
  if (!report.contains("intervals")) return rows;
  for (const Json& interval : report.at("intervals")) {
    const Json& sum = interval.at("sum");
    if (sum.value("omitted", false)) continue;
    const double start_s = sum.at("start").get<double>();
    if (sum.contains("lost_packets") && !sum.value("sender", false)) {
      add_udp(rows, start_s, sum.at("packets").get<double>(), sum.at("lost_packets").get<double>());
      continue;
    }
    for (const Json& stream : interval.at("streams")) {
      if (!stream.contains("rtt") || stream.at("rtt").get<double>() <= 0.0) continue;
      add_row(rows, {start_s, 0.5e-3 * stream.at("rtt").get<double>(), 1.0});
      break;  // only the first of several streams
    }
  }
  return rows;
}

Rows from_json(const std::string& text, const std::string& name) {
  try {
    const Json report = parse_json(text);
    if (report.contains("error")) {
      throw UsageError(fmt::format("{}: iperf3 says: {}", name,
                                   printable(report.at("error").get<std::string>(), 200)));
    }
    Rows rows;
    if (report.contains("server_output_json")) rows = intervals(report.at("server_output_json"));
    if (rows.empty()) rows = intervals(report);
    if (rows.empty() &&
        report.contains("server_output_text")) {  // only from a server without --json
      return from_text(report.at("server_output_text").get<std::string>(),
                       name + ": server_output_text");
    }
    if (rows.empty()) throw UsageError(fmt::format("{}: {}", name, kNoReceiver));
    return rows;
  } catch (const Json::exception& error) {
    throw UsageError(
        fmt::format("{}: no report of iperf3: {}", name, printable(error.what(), 200)));
  }
}

}  // namespace

Imported import_iperf3(const std::string& text, const std::string& name) {
  const std::size_t begin = text.find_first_not_of(" \t\r\n");
  const bool is_json = begin != std::string::npos && text[begin] == '{';
  Imported imported;
  imported.rows = is_json ? from_json(text, name) : from_text(text, name);
  imported.has_delays = imported.rows.front().delay_ms.has_value();
  const double first_s = imported.rows.front().time_s;
  for (Imported::Row& row : imported.rows) {
    row.time_s -= first_s;
    if (!std::isfinite(row.time_s) || !(row.prr >= 0.0)) {
      throw UsageError(fmt::format(
          "{}: in an interval of it more packets are lost than were sent, or its time is no number",
          name));
    }
  }
  imported.notes.push_back(imported.has_delays
                               ? "delays are half TCP's round trips; losses are not known"
                               : "losses by interval; delays are not known");
  return imported;
}

}  // namespace tether
