#include "netem/fit/data.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "netem/fit/reception_runs.hpp"

namespace tether {
namespace {

using Segment = std::vector<LoggedPacket>;

/// Whether fewer than one packet in kMostLostEach has arrived: not a channel, but wrong numbers.
bool is_mostly_gaps(const std::vector<Reception>& arrivals) {
  constexpr double kMostLostEach = 1000.0;
  const double packets =
      static_cast<double>(arrivals.back().seq) - static_cast<double>(arrivals.front().seq) + 1.0;
  return packets > kMostLostEach * static_cast<double>(arrivals.size() + 1);
}

/// The packets of one segment, from its arrivals sorted by number, without duplicates.
Segment fill_gaps(const std::vector<Reception>& arrivals) {
  Segment segment;
  for (const Reception& r : arrivals) {
    if (!segment.empty()) {
      const LoggedPacket before = segment.back();
      const std::int64_t steps =
          r.seq - arrivals[0].seq - static_cast<std::int64_t>(segment.size()) + 1;
      for (std::int64_t k = 1; k < steps; ++k) {
        const double share = static_cast<double>(k) / static_cast<double>(steps);
        segment.push_back({before.time_s + share * (r.time_s - before.time_s), true});
      }
    }
    segment.push_back({r.time_s, false, r.delay_s});
  }
  return segment;
}

double quantile(std::vector<double>& values, double q) {
  const auto rank = static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  return values[static_cast<std::size_t>(rank)];
}

/// Arrival times that went back, by reordering, are set to the latest before.
void make_monotone(Segment& segment) {
  double latest_s = segment.front().time_s;
  for (LoggedPacket& p : segment) p.time_s = latest_s = std::max(latest_s, p.time_s);
}

void regularise(FateLog& log) {
  std::vector<double> intervals;
  double span_s = 0.0;
  for (Segment& segment : log.segments) {
    make_monotone(segment);
    span_s += segment.back().time_s - segment.front().time_s;
    for (std::size_t i = 1; i < segment.size(); ++i) {
      intervals.push_back(segment[i].time_s - segment[i - 1].time_s);
    }
  }
  if (intervals.empty()) return;
  log.interval_s = span_s / static_cast<double>(intervals.size());
  const double tolerance_s = 0.25 * log.interval_s;
  log.periodic =
      log.interval_s > 0.0 && std::abs(quantile(intervals, 0.5) - log.interval_s) <= tolerance_s;
  for (double& x : intervals) x = std::abs(x - log.interval_s);
  log.periodic = log.periodic && quantile(intervals, 0.75) <= tolerance_s;
  if (!log.periodic) return;
  for (Segment& segment : log.segments) {
    for (std::size_t i = 1; i < segment.size(); ++i) {
      segment[i].time_s = segment[0].time_s + static_cast<double>(i) * log.interval_s;
    }
  }
}

}  // namespace

std::int64_t FateLog::packets() const {
  std::int64_t sum = 0;
  for (const Segment& s : segments) sum += static_cast<std::int64_t>(s.size());
  return sum;
}

std::int64_t FateLog::lost() const {
  std::int64_t sum = 0;
  for (const Segment& s : segments) {
    sum += std::count_if(s.begin(), s.end(), [](const LoggedPacket& p) { return p.lost; });
  }
  return sum;
}

FateLog fates_from_receptions(const std::vector<Reception>& receptions) {
  FateLog log;
  ReceptionRuns divided = divide_into_runs(receptions);
  log.implausible = divided.implausible;
  for (std::vector<Reception>& arrivals : divided.runs) {
    std::int64_t highest = arrivals.empty() ? 0 : arrivals.front().seq;
    for (const Reception& r : arrivals) {
      if (r.seq < highest) ++log.reordered;
      highest = std::max(highest, r.seq);
    }
    const auto by_number = [](const Reception& a, const Reception& b) { return a.seq < b.seq; };
    const auto same = [](const Reception& a, const Reception& b) { return a.seq == b.seq; };
    std::stable_sort(arrivals.begin(), arrivals.end(), by_number);
    const auto end = std::unique(arrivals.begin(), arrivals.end(), same);
    log.duplicated += arrivals.end() - end;
    arrivals.erase(end, arrivals.end());
    if (arrivals.empty()) continue;
    if (is_mostly_gaps(arrivals)) {
      log.implausible += std::ssize(arrivals);
    } else {
      log.segments.push_back(fill_gaps(arrivals));
    }
  }
  regularise(log);
  return log;
}

FateLog fates_from_packets(std::vector<LoggedPacket> packets) {
  FateLog log;
  if (packets.empty()) return log;
  log.segments.push_back(std::move(packets));
  regularise(log);
  return log;
}

}  // namespace tether
