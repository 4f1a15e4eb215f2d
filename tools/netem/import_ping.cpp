#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <string_view>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "tools/netem/import.hpp"

namespace tether {
namespace {

// Sequence numbers of echo requests; then they begin again.
constexpr std::int64_t kNumbers = 65536;
// Limits on lost packets, which have no line: in all, and for each line.
constexpr std::int64_t kMostPackets = 20'000'000, kMostSilent = 100'000, kMostSilentEach = 100;
constexpr double kMostTime_ms = 1e9, kMostStamp_s = 1e11;
constexpr double kBelow1_ms = 0.5;    // value for Windows' "time<1ms"
constexpr double kShortest_s = 1e-6;  // from one packet to the next

/// A line, and how errors name it.
struct Line {
  std::string_view text;
  std::string place;
};

/// The number behind `label`; none without the label. Throws if it goes on in a way that is not
/// read, such as "10,5" or "1e3".
template <class Number>
std::optional<Number> number_after(const Line& line, std::string_view label) {
  const std::size_t at = line.text.find(label);
  if (at == std::string_view::npos) return std::nullopt;
  const std::string_view rest = line.text.substr(at + label.size());
  const std::size_t end = std::min(rest.find_first_not_of("0123456789."), rest.size());
  const auto number = to_number<Number>(rest.substr(0, end));
  const bool ends =
      end == rest.size() || std::string_view(" \t\r:]m").find(rest[end]) != std::string_view::npos;
  if (number && ends) return number;
  throw UsageError(fmt::format("{}: \"{}\" behind \"{}\" must be digits with at most a point",
                               line.place, printable(rest.substr(0, rest.find_first_of(" \t\r:]"))),
                               trimmed(label)));
}

struct Echo {
  std::optional<double> round_trip_ms;  ///< none: no answer
  std::optional<double> sent_s;
};

/// By their numbers, which go on where they begin again.
class Echoes {
 public:
  void add(const Line& line) {
    if (add_windows(line)) return;
    auto seq = number_after<std::int64_t>(line, "icmp_seq=");
    if (!seq) seq = number_after<std::int64_t>(line, " seq=");
    if (!seq) {
      if (line.text.find(" packets transmitted") != std::string_view::npos) {
        transmitted_ = to_number<std::int64_t>(line.text.substr(0, line.text.find(' ')));
        if (transmitted_ && *transmitted_ > kMostPackets) transmitted_.reset();
      }
      return;
    }
    check(line, "the number", static_cast<double>(*seq), kMostPackets);
    Echo& echo = all_[unwrapped(*seq)];
    const auto time_ms = number_after<double>(line, " time=");
    check(line, "the round trip in ms", time_ms.value_or(0.0), kMostTime_ms);
    if (!time_ms || line.text.find("(DUP!)") != std::string_view::npos) return;
    if (line.text.find(" ms") == std::string_view::npos) {
      throw UsageError(fmt::format("{}: a time that is not in ms", line.place));
    }
    echo.round_trip_ms = *time_ms;
    if (line.text.starts_with('[')) {
      if (const auto stamp = number_after<double>(line, "[")) {
        check(line, "the time in s", *stamp, kMostStamp_s);
        echo.sent_s = *stamp - *time_ms * 1e-3;
      }
    }
  }

  /// First number sent, also if it is before the first in the file.
  std::int64_t first() const {
    const std::int64_t told = all_.begin()->first;
    return transmitted_ ? std::min<std::int64_t>(1, told) : told;
  }
  std::int64_t last() const {
    return std::max(all_.rbegin()->first, first() + transmitted_.value_or(0) - 1);
  }

  const std::map<std::int64_t, Echo>& all() const { return all_; }
  bool are_of_windows() const { return of_windows_ > 0; }

 private:
  static void check(const Line& line, const char* what, double value, double most) {
    if (value >= 0.0 && value <= most) return;
    throw UsageError(
        fmt::format("{}: {} is {:g}, which must be in [0, {:g}]", line.place, what, value, most));
  }

  /// Windows' ping numbers nothing, but writes a line for each: "Reply from 192.0.2.7: bytes=32
  /// time=12ms TTL=57" (or time<1ms), "Request timed out.", "Reply from 192.0.2.1: Destination host
  /// unreachable." False: not such a line.
  bool add_windows(const Line& line) {
    const bool is_below = line.text.find(" time<1ms") != std::string_view::npos;
    const bool is_reply = line.text.starts_with("Reply from ");
    if (!is_reply && !line.text.starts_with("Request timed out") &&
        !line.text.starts_with("Destination ") && !line.text.starts_with("General failure"))
      return false;
    Echo& echo = all_[++of_windows_];
    if (is_reply) echo.round_trip_ms = number_after<double>(line, " time=");
    if (is_reply && is_below) echo.round_trip_ms = kBelow1_ms;
    return true;
  }

  std::int64_t unwrapped(std::int64_t seq) const {
    if (all_.empty()) return seq;
    const std::int64_t last = all_.rbegin()->first;
    std::int64_t round = last / kNumbers;
    if (seq + kNumbers / 2 < last % kNumbers) ++round;
    if (round > 0 && seq > last % kNumbers + kNumbers / 2) --round;
    return round * kNumbers + seq;
  }

  std::map<std::int64_t, Echo> all_;
  std::optional<std::int64_t> transmitted_;
  std::int64_t of_windows_ = 0;
};

/// When each packet was sent: as known, else evenly between those that are known.
class SendTimes {
 public:
  SendTimes(const std::map<std::int64_t, Echo>& echoes, double interval_s)
      : interval_s_(interval_s) {
    for (const auto& [number, echo] : echoes) {
      if (echo.sent_s) known_.emplace_hint(known_.end(), number, *echo.sent_s);
    }
    if (known_.size() < 2) return;
    const auto &first = *known_.begin(), &last = *known_.rbegin();
    interval_s_ = (last.second - first.second) / static_cast<double>(last.first - first.first);
  }

  bool are_known() const { return !known_.empty(); }
  double interval_s() const { return interval_s_; }
  double at(std::int64_t number) const {
    if (known_.empty()) return static_cast<double>(number) * interval_s_;
    const auto after = known_.lower_bound(number);
    if (after == known_.begin()) return from(*after, number);
    const auto before = std::prev(after);
    if (after == known_.end()) return from(*before, number);
    const double share = static_cast<double>(number - before->first) /
                         static_cast<double>(after->first - before->first);
    return before->second + share * (after->second - before->second);
  }

 private:
  double from(const std::pair<const std::int64_t, double>& one, std::int64_t number) const {
    return one.second + static_cast<double>(number - one.first) * interval_s_;
  }

  double interval_s_;
  std::map<std::int64_t, double> known_;
};

}  // namespace

Imported import_ping(std::istream& in, const std::string& name, double interval_s) {
  Echoes echoes;
  int line_number = 0;
  for (std::string line; std::getline(in, line);) {
    echoes.add({line, fmt::format("{}:{}", name, ++line_number)});
  }
  if (echoes.all().empty()) {
    throw UsageError(
        name +
        ": no line has icmp_seq= or seq=, as those of ping on Linux, macOS and busybox, nor begins "
        "with \"Reply from\", as Windows' in English");
  }
  const std::int64_t first = echoes.first(), last = echoes.last();
  const auto told = static_cast<std::int64_t>(echoes.all().size());
  const std::int64_t most = std::min(kMostPackets, kMostSilent + kMostSilentEach * told);
  if (last - first >= most) {
    throw UsageError(
        fmt::format("{}: numbers from {} to {}, of which the file has {}; at most {} "
                    "packets are taken of so few",
                    name, first, last, told, most));
  }
  const SendTimes times(echoes.all(), interval_s);
  if (times.interval_s() < kShortest_s) {
    throw UsageError(fmt::format(
        "{}: the times in brackets are {:g} s apart on average, from the first to the last; at "
        "least {:g} s are taken",
        name, times.interval_s(), kShortest_s));
  }
  Imported imported;
  imported.of_fates = imported.has_delays = true;
  for (std::int64_t number = first; number <= last; ++number) {
    const auto found = echoes.all().find(number);
    Imported::Row row{.time_s = times.at(number) - times.at(first), .prr = 0.0};
    if (!imported.rows.empty()) {
      row.time_s = std::max(row.time_s, imported.rows.back().time_s + kShortest_s);
    }
    if (found != echoes.all().end() && found->second.round_trip_ms) {
      row.prr = 1.0;
      row.delay_ms = 0.5 * *found->second.round_trip_ms;
    }
    imported.rows.push_back(row);
  }
  imported.notes.push_back("delays are half the round trips; a packet is lost there or back");
  imported.notes.push_back(
      times.are_known()
          ? fmt::format("times are those of sending, one every {:.4g} s", times.interval_s())
          : fmt::format("no times{}: one every {:g} s is assumed",
                        echoes.are_of_windows() ? ", and Windows waits 4 s for what is lost (-w)"
                                                : " (ping -D)",
                        interval_s));
  return imported;
}

}  // namespace tether
