#include "tools/netem/fit.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>
#include <string_view>

#include "common/base/csv_table.hpp"
#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/base/text.hpp"
#include "tools/messages/event_log.hpp"
#include "tools/messages/message_printer.hpp"

namespace tether {
namespace {

constexpr double kLongest_s = 1e9, kMostDelay_ms = 1e12;

/// Time of a row; `first_s`: of the first one.
double time_of(const CsvTable& table, std::optional<double>& first_s) {
  const double time_s = table.number("time_s");
  if (!first_s) first_s = time_s;
  const bool is_near = std::abs(time_s) <= 1e10 && std::abs(time_s - *first_s) <= kLongest_s;
  if (!is_near) table.refuse("time_s", "within 1e9 s of the first row's, and within 1e10 s of 0");
  return time_s;
}

double delay_of(const CsvTable& table) {
  if (!table.has("delay_ms") || table.cell("delay_ms").empty()) return NAN;
  const double delay_ms = table.number("delay_ms");
  if (delay_ms < 0.0 || delay_ms > kMostDelay_ms) {
    table.refuse("delay_ms", "empty or a number in [0, 1e12]");
  }
  return delay_ms * 1e-3;
}

FateLog read_packets(CsvTable& table) {
  std::vector<LoggedPacket> packets;
  std::optional<double> first_s;
  while (table.next_row()) {
    const std::string_view lost = table.cell("lost");
    if (lost != "0" && lost != "1") table.refuse("lost", "0 or 1");
    const double time_s = time_of(table, first_s);
    if (!packets.empty() && time_s < packets.back().time_s) {
      table.fail(fmt::format("time_s goes back from {} to {}", packets.back().time_s, time_s));
    }
    packets.push_back({time_s, lost == "1", lost == "1" ? NAN : delay_of(table)});
  }
  return fates_from_packets(std::move(packets));
}

/// "1 duplicate", "3 duplicates".
std::string counted(std::int64_t count, const char* one, const char* many) {
  return fmt::format("{} {}", count, count == 1 ? one : many);
}

std::vector<std::string> notes_on(const FateLog& log) {
  std::vector<std::string> notes;
  if (log.segments.size() > 1) {
    notes.push_back(
        fmt::format("the sender restarted {}; losses in between are not known",
                    counted(static_cast<std::int64_t>(log.segments.size()) - 1, "time", "times")));
  }
  if (log.implausible > 0) {
    notes.push_back(counted(log.implausible, "arrival", "arrivals") +
                    " left out: sequence number or time does not fit the others (damaged?)");
  }
  if (log.duplicated > 0) {
    notes.push_back(counted(log.duplicated, "duplicate", "duplicates") + " left out");
  }
  if (log.reordered > 0) notes.push_back(fmt::format("{} arrived out of order", log.reordered));
  return notes;
}

std::string describe_damage(const std::vector<LogDamage>& damage) {
  std::uint64_t bytes = 0;
  for (const LogDamage& d : damage) bytes += d.size_bytes;
  return fmt::format(
      "the log is damaged in {}, {} bytes in all; what is missing there counts as lost",
      counted(static_cast<std::int64_t>(damage.size()), "place", "places"), bytes);
}

/// One channel of an event log.
struct LogStream {
  std::vector<Reception> receptions;
  std::int64_t without_number = 0;
};

}  // namespace

FitInput fit_input_from(const std::vector<Reception>& receptions, const std::string& description,
                        const std::vector<std::string>& findings) {
  FitInput input{fates_from_receptions(receptions), description, {}};
  std::string reasons;
  for (const std::string& finding : findings) reasons += "; " + finding;
  const auto refuse = [&](std::int64_t count, const char* what) {
    throw std::runtime_error(
        fmt::format("{}: the sequence numbers do not fit the times: {} of {} arrivals {}",
                    description, count, receptions.size(), what) +
        reasons);
  };
  const auto arrivals = static_cast<double>(receptions.size());
  if (static_cast<double>(input.log.implausible) > kMostImplausible * arrivals) {
    refuse(input.log.implausible, "belong to no run of numbers");
  }
  if (static_cast<double>(input.log.duplicated) > kMostCopies * arrivals) {
    refuse(input.log.duplicated, "have a number that had arrived");
  }
  input.notes = notes_on(input.log);
  input.notes.insert(input.notes.end(), findings.begin(), findings.end());
  return input;
}

FitInput read_fit_csv(std::istream& in, const std::string& name) {
  CsvTable table(in, name);
  if (!table.has("time_s") || (!table.has("seq") && !table.has("lost"))) {
    table.fail("the header must name the columns seq and time_s, or time_s and lost");
  }
  if (table.has("lost")) return {read_packets(table), name, {}};
  std::vector<Reception> receptions;
  std::optional<double> first_s;
  while (table.next_row()) {
    const std::int64_t seq = table.whole_number("seq");
    if (seq < 0) table.refuse("seq", "a whole number >= 0");
    receptions.push_back({seq, time_of(table, first_s), delay_of(table)});
  }
  return fit_input_from(receptions, name);
}

FitInput read_fit_log(std::istream& in, const std::string& name, const std::string& channel) {
  constexpr std::int64_t kYear2000_us = 946'684'800'000'000;
  constexpr std::size_t kMostChannels = 1000;
  EventLogReader reader(in);
  LoggedEvent event;
  std::map<std::string, std::int64_t> numbered;  // channels with sequence numbers
  std::map<std::string, LogStream> streams;
  while (reader.next(event)) {
    if (!channel.empty() && event.channel != channel) continue;
    const MessageContent message = inspect_message(event.data);
    const auto seq = message.integer("seq"), utime = message.integer("utime");
    if (streams.size() == kMostChannels && streams.count(event.channel) == 0) continue;
    LogStream& stream = streams[event.channel];
    if (!seq || *seq < 0) {
      ++stream.without_number;
      continue;
    }
    ++numbered[event.channel];
    Reception r{*seq, static_cast<double>(event.timestamp_us) * 1e-6};
    if (utime && event.timestamp_us < kYear2000_us && *utime <= event.timestamp_us &&
        *utime >= -kYear2000_us) {
      r.delay_s = static_cast<double>(event.timestamp_us - *utime) * 1e-6;
    }
    stream.receptions.push_back(r);
  }
  if (numbered.size() != 1) {
    std::vector<std::string> names;
    for (const auto& [label, count] : numbered) names.push_back(printable(label));
    throw UsageError(
        numbered.empty()
            ? fmt::format("{}: no messages with a sequence number{}", name,
                          channel.empty() ? "" : fmt::format(" on channel \"{}\"", channel))
            : fmt::format("{} has several channels; choose one with --channel: {}", name,
                          fmt::join(names, ", ")));
  }
  const std::string& chosen = numbered.begin()->first;
  const LogStream& stream = streams[chosen];
  std::vector<std::string> findings;
  if (stream.without_number > 0) {
    findings.push_back(
        fmt::format("{} messages without a sequence number left out", stream.without_number));
  }
  if (!reader.damage().empty()) findings.push_back(describe_damage(reader.damage()));
  return fit_input_from(stream.receptions, fmt::format("{}, channel {}", name, printable(chosen)),
                        findings);
}

FitInput read_fit_input(const std::string& path, const FitSelection& selection) {
  std::ifstream in = open_input(path, "the recording", kMostRecordingBytes);
  std::string first(4, '\0');
  in.read(first.data(), 4);
  in.clear();
  in.seekg(0);
  const std::set<std::string> pcap{"\xa1\xb2\xc3\xd4", "\xd4\xc3\xb2\xa1", "\xa1\xb2\x3c\x4d",
                                   "\x4d\x3c\xb2\xa1"};
  if (first == "\xed\xa1\xda\x01") return read_fit_log(in, path, selection.channel);
  if (pcap.count(first) > 0) return read_fit_pcap(in, path, selection.sender);
  if (first == "\x0a\x0d\x0d\x0a") {
    throw UsageError(
        fmt::format("{} is in pcapng format; convert it: editcap -F pcap {} out.pcap", path, path));
  }
  check_input(path, "the table", kMostTableBytes);
  return read_fit_csv(in, path);
}

}  // namespace tether
