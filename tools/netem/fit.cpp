#include "tools/netem/fit.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <stdexcept>
#include <string_view>
#include <utility>

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

// Formats: pcap-savefile(5), www.tcpdump.org/linktypes.html, RFC 791, RFC 768, and LCM's UDP
// multicast protocol (lcm/lcm_udpm.c, udpm_util.h): magic "LC02" (whole messages) or "LC03"
// (fragments), u32 sequence number; fragments then have u32 message size, u32 offset, u16 fragment
// number and u16 number of fragments; all big endian.

namespace {

using Bytes = std::span<const std::uint8_t>;

std::uint32_t big_endian(Bytes bytes, std::size_t offset, std::size_t size) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < size; ++i) value = value << 8 | bytes[offset + i];
  return value;
}

/// Numbers of the file's own header and of its records, in the byte order of who wrote it.
class PcapReader {
 public:
  PcapReader(std::istream& in, std::string name) : in_(in), name_(std::move(name)) {
    std::array<std::uint8_t, 24> header{};
    if (!read(header)) throw UsageError(fmt::format("{}: too short for a pcap file", name_));
    swapped_ = header[0] == 0xd4 || header[0] == 0x4d;      // little endian
    nanoseconds_ = header[1] == 0x3c || header[2] == 0x3c;  // 4d 3c b2 a1, a1 b2 3c 4d
    link_type = number(header, 20) & 0x0fffffffU;
  }

  /// Whether there is another record. A file that breaks off in a record ends before it.
  bool next(std::vector<std::uint8_t>& frame, double& time_s) {
    std::array<std::uint8_t, 16> header{};
    if (!read(header)) return false;
    const std::uint32_t size = number(header, 8);
    constexpr std::uint32_t kLargest = 262'144;  // tcpdump's own limit
    if (size > kLargest) {
      throw UsageError(fmt::format("{}: the record at byte {} claims {} bytes: damaged", name_,
                                   position_ - header.size(), size));
    }
    time_s = number(header, 0) + number(header, 4) * (nanoseconds_ ? 1e-9 : 1e-6);
    frame.resize(size);
    return read(frame);
  }

  std::uint32_t link_type = 0;

 private:
  bool read(std::span<std::uint8_t> bytes) {
    in_.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    position_ += bytes.size();
    return static_cast<std::size_t>(in_.gcount()) == bytes.size();
  }
  std::uint32_t number(Bytes bytes, std::size_t offset) const {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      value = value << 8 | bytes[offset + (swapped_ ? 3 - i : i)];
    }
    return value;
  }

  std::istream& in_;
  std::string name_;
  std::uint64_t position_ = 0;
  bool swapped_ = false;
  bool nanoseconds_ = false;
};

/// The IPv4 packet of a captured frame; empty if it is not IPv4.
Bytes ip_packet(Bytes frame, std::uint32_t link_type) {
  constexpr std::uint32_t kIpv4 = 0x0800, kVlan = 0x8100, kServiceVlan = 0x88a8;
  const auto after = [&](std::size_t header, std::size_t type_at) {
    if (frame.size() < header) return Bytes{};
    return big_endian(frame, type_at, 2) == kIpv4 ? frame.subspan(header) : Bytes{};
  };
  switch (link_type) {
    case 1: {  // Ethernet, with any number of VLAN tags
      std::size_t type_at = 12;
      while (frame.size() >= type_at + 6 && (big_endian(frame, type_at, 2) == kVlan ||
                                             big_endian(frame, type_at, 2) == kServiceVlan)) {
        type_at += 4;
      }
      return after(type_at + 2, type_at);
    }
    case 113:
      return after(16, 14);  // Linux cooked
    case 276:
      return after(20, 0);  // Linux cooked, version 2
    case 0:                 // BSD loopback
    case 108:
      return frame.size() > 4 ? frame.subspan(4) : Bytes{};
    case 12:  // raw IP, as some systems number it
    case 101:
    case 228:
      return frame;
    default:
      return {};
  }
}

struct LcmPacket {
  std::string sender;
  std::uint32_t seq = 0;
};

/// The message that a captured frame is, or begins.
std::optional<LcmPacket> lcm_packet(Bytes frame, std::uint32_t link_type) {
  constexpr std::uint32_t kWhole = 0x4c433032, kFragment = 0x4c433033, kUdp = 17;
  const Bytes ip = ip_packet(frame, link_type);
  if (ip.size() < 20 || ip[0] >> 4 != 4 || ip[9] != kUdp) return std::nullopt;
  const std::size_t header = static_cast<std::size_t>(ip[0] & 0x0f) * 4;
  const bool later_ip_fragment = (big_endian(ip, 6, 2) & 0x1fffU) != 0;
  if (later_ip_fragment || header < 20 || ip.size() < header + 8 + 8) return std::nullopt;
  const Bytes udp = ip.subspan(header), lcm = udp.subspan(8);
  const std::uint32_t magic = big_endian(lcm, 0, 4);
  if (magic == kFragment && (lcm.size() < 20 || big_endian(lcm, 16, 2) != 0)) return std::nullopt;
  if (magic != kWhole && magic != kFragment) return std::nullopt;
  return LcmPacket{
      fmt::format("{}.{}.{}.{}:{}", ip[12], ip[13], ip[14], ip[15], big_endian(udp, 0, 2)),
      big_endian(lcm, 4, 4)};
}

}  // namespace

FitInput read_fit_pcap(std::istream& in, const std::string& name, const std::string& sender) {
  PcapReader reader(in, name);
  constexpr std::array<std::uint32_t, 8> kLinkTypes{0, 1, 12, 101, 108, 113, 228, 276};
  if (std::find(kLinkTypes.begin(), kLinkTypes.end(), reader.link_type) == kLinkTypes.end()) {
    throw UsageError(fmt::format("{}: link type {} is not supported", name, reader.link_type));
  }
  constexpr std::size_t kMostSenders = 1000;
  std::map<std::string, std::vector<Reception>> senders;
  std::vector<std::uint8_t> frame;
  double time_s = 0.0;
  while (reader.next(frame, time_s)) {
    const auto packet = lcm_packet(frame, reader.link_type);
    if (!packet || (!sender.empty() && packet->sender != sender)) continue;
    if (senders.size() == kMostSenders && senders.count(packet->sender) == 0) continue;
    senders[packet->sender].push_back({packet->seq, time_s});
  }
  if (senders.empty()) {
    throw UsageError(fmt::format("{}: no LCM messages over UDP and IPv4{}", name,
                                 sender.empty() ? "" : " from " + sender));
  }
  if (senders.size() > 1) {
    std::vector<std::string> names;
    for (const auto& [label, receptions] : senders) {
      names.push_back(fmt::format("{} ({} messages)", label, receptions.size()));
    }
    throw UsageError(fmt::format("{} has several senders; choose one with --sender: {}", name,
                                 fmt::join(names, ", ")));
  }
  const auto& [chosen, receptions] = *senders.begin();
  return fit_input_from(receptions, fmt::format("{}, LCM messages from {}", name, chosen));
}

}  // namespace tether
