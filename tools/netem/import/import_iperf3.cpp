#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string_view>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "tools/netem/import/import.hpp"

namespace tether {
namespace {

using Json = nlohmann::json;

constexpr char kNoReceiver[] =
    "{}: no report of a receiver of UDP, whose losses are wanted (iperf3 -s, or -c with "
    "--get-server-output), nor round trips of a sender of TCP (iperf3 -c … -J)";

void add_row(Imported& imported, Imported::Row row) {
  if (!imported.rows.empty() && row.time_s <= imported.rows.back().time_s) return;  // the summary
  imported.rows.push_back(row);
}

/// What comes late, after it was counted as lost, iperf3 takes back from an interval's losses,
/// which may then be below 0.
void add_udp(Imported& imported, double start_s, double packets, double lost) {
  if (packets > 0.0)
    add_row(imported, {start_s, std::nullopt, std::min(1.0, 1.0 - lost / packets)});
}

/// The intervals of a report in JSON; false if they have neither losses nor round trips.
bool add_intervals(Imported& imported, const Json& report) {
  if (!report.contains("intervals")) return false;
  for (const Json& interval : report.at("intervals")) {
    const Json& sum = interval.at("sum");
    const double start_s = sum.at("start").get<double>();
    if (sum.contains("lost_packets") && !sum.value("sender", false)) {
      add_udp(imported, start_s, sum.at("packets").get<double>(),
              sum.at("lost_packets").get<double>());
      continue;
    }
    for (const Json& stream : interval.at("streams")) {
      if (!stream.contains("rtt") || stream.at("rtt").get<double>() <= 0.0) continue;
      add_row(imported, {start_s, 0.5e-3 * stream.at("rtt").get<double>(), 1.0});
      imported.has_delays = true;
      break;  // of several streams the first
    }
  }
  return !imported.rows.empty();
}

/// "[  5]   0.00-1.00   sec   128 KBytes  1.05 Mbits/sec  0.012 ms  3/90 (3.3%)"; other lines do
/// not count.
void add_line(Imported& imported, const std::string& line) {
  std::istringstream words(line.substr(std::min(line.find(']'), line.size() - 1) + 1));
  std::string span, unit, word;
  words >> span >> unit;
  const std::size_t dash = span.find('-');
  if (unit != "sec" || dash == std::string::npos) return;
  const auto start_s = to_number<double>(std::string_view(span).substr(0, dash));
  while (words >> word) {
    const std::size_t slash = word.find('/');
    if (slash == std::string::npos) continue;
    const auto lost = to_number<double>(std::string_view(word).substr(0, slash));
    const auto packets = to_number<double>(std::string_view(word).substr(slash + 1));
    if (start_s && lost && packets) add_udp(imported, *start_s, *packets, *lost);
  }
}

Imported from_json(const std::string& text, const std::string& name) {
  Imported imported;
  try {
    const Json report = Json::parse(text);
    if (report.contains("error")) {
      throw UsageError(fmt::format("{}: iperf3 says: {}", name,
                                   printable(report.at("error").get<std::string>(), 200)));
    }
    const bool from_server = report.contains("server_output_json") &&
                             add_intervals(imported, report.at("server_output_json"));
    if (!from_server) add_intervals(imported, report);
  } catch (const Json::exception& error) {
    throw UsageError(
        fmt::format("{}: no report of iperf3: {}", name, printable(error.what(), 200)));
  }
  return imported;
}

}  // namespace

Imported import_iperf3(const std::string& text, const std::string& name) {
  Imported imported;
  if (const std::size_t begin = text.find_first_not_of(" \t\r\n");
      begin != std::string::npos && text[begin] == '{') {
    imported = from_json(text, name);
  } else {
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
      if (!line.empty()) add_line(imported, line);
    }
  }
  if (imported.rows.empty()) throw UsageError(fmt::format(kNoReceiver, name));
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
