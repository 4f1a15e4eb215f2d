#include "netem/fit/data.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <set>
#include <utility>
#include <vector>

namespace tether {
namespace {

/// The arrivals of a log, divided by the sender's runs.
struct ReceptionRuns {
  /// Each run's arrivals, in the order of arrival; copies and late ones are among them.
  std::vector<std::vector<Reception>> runs;
  /// Arrivals left out, because neither their run nor a new one explains their number and time.
  std::int64_t implausible = 0;
};

constexpr double kSlack_s = 2.0;
constexpr double kSlackIntervals = 20.0;
constexpr double kFaster = 3.0;           // than the median a sender may be
constexpr std::size_t kNewRun = 3;        // arrivals that make one
constexpr std::size_t kRepeatedRun = 16;  // if they may be copies
constexpr double kMostLost = 1e6;         // without times
constexpr std::int64_t kMostReordered = 1000;

double median(std::vector<double>& values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Numbers may be damaged: their differences as whole numbers might overflow.
double steps_between(const Reception& a, const Reception& b) {
  return static_cast<double>(b.seq) - static_cast<double>(a.seq);
}

double interval_over(const std::vector<Reception>& receptions, std::size_t stride) {
  std::vector<double> intervals;
  for (std::size_t i = stride; i < receptions.size(); ++i) {
    const double steps = steps_between(receptions[i - stride], receptions[i]);
    const double elapsed_s = receptions[i].time_s - receptions[i - stride].time_s;
    if (steps >= 1.0 && elapsed_s >= 0.0) intervals.push_back(elapsed_s / steps);
  }
  return median(intervals);
}

/// 0 if the times do not tell.
double median_interval(const std::vector<Reception>& receptions) {
  const double next_s = interval_over(receptions, 1);
  const double far_s =
      interval_over(receptions, std::clamp<std::size_t>(receptions.size() / 8, 1, 64));
  return next_s > 0.0 && far_s > 0.0 ? std::min(next_s, far_s) : std::max(next_s, far_s);
}

class RunDivider {
 public:
  explicit RunDivider(double interval_s)
      : interval_s_(interval_s), slack_s_(std::max(kSlack_s, kSlackIntervals * interval_s)) {}

  void add(const Reception& r) {
    const Place place = place_of(r);
    if (place == Place::next || place == Place::late) {
      drop_candidates();
      accept(r);
      if (place == Place::late) follow_repetition(r);
      return;
    }
    if (candidates_.empty() || !goes_on(candidates_.back(), r)) {
      drop_candidates();
      after_pause_ = place == Place::after_pause;
    }
    candidates_.push_back(r);
    // After a pause the first few arrivals may as well be those with a damaged time.
    if (after_pause_ && candidates_.size() == 2 && run_.size() >= kNewRun) {
      for (const Reception& c : std::exchange(candidates_, {})) accept(c);
    } else if (candidates_.size() == kNewRun) {
      begin_run(std::exchange(candidates_, {}));
    }
  }

  ReceptionRuns finish() {
    // No later arrival can confirm the last arrival's pause: one shorter than the run itself is
    // believed.
    if (candidates_.size() == 1 && after_pause_ &&
        candidates_[0].time_s - last_s_ <= last_s_ - run_.front().time_s) {
      accept(candidates_[0]);
      candidates_.clear();
    }
    drop_candidates();
    end_run(result_.runs.empty() ? 1 : kNewRun);
    return std::move(result_);
  }

 private:
  enum class Place { next, after_pause, late, nowhere };
  struct Advance {
    std::int64_t seq;
    double time_s;
  };

  bool can_be_ahead(double steps, double elapsed_s) const {
    if (!(interval_s_ > 0.0)) return steps <= kMostLost;
    return steps <= 1.0 + (kFaster * std::max(0.0, elapsed_s) + slack_s_) / interval_s_;
  }

  bool goes_on(const Reception& from, const Reception& to) const {
    const double steps = steps_between(from, to), elapsed_s = to.time_s - from.time_s;
    return steps >= 1.0 && elapsed_s >= -slack_s_ && can_be_ahead(steps, elapsed_s);
  }

  Place place_of(const Reception& r) const {
    if (run_.empty()) return Place::next;
    if (r.time_s < last_s_ - slack_s_) return Place::nowhere;
    const Advance& top = advances_.back();
    if (r.seq <= top.seq) return is_late(r) ? Place::late : Place::nowhere;
    const double steps = static_cast<double>(r.seq) - static_cast<double>(top.seq);
    if (!can_be_ahead(steps, r.time_s - top.time_s)) return Place::nowhere;
    const bool paused =
        interval_s_ > 0.0 && r.time_s - last_s_ > steps * interval_s_ * kFaster + slack_s_;
    return paused ? Place::after_pause : Place::next;
  }

  bool is_late(const Reception& r) const {
    const Advance& first = advances_.front();
    if (!(interval_s_ > 0.0)) {
      return static_cast<double>(advances_.back().seq) - static_cast<double>(r.seq) <=
             static_cast<double>(kMostReordered);
    }
    if (r.seq < first.seq) {
      const double steps = static_cast<double>(first.seq) - static_cast<double>(r.seq);
      return r.time_s - first.time_s + steps * interval_s_ <= slack_s_;
    }
    const auto passed = std::lower_bound(
        advances_.begin(), advances_.end(), r.seq,
        [](const Advance& advance, std::int64_t seq) { return advance.seq < seq; });
    return r.time_s - passed->time_s <= slack_s_;
  }

  void accept(const Reception& r) {
    run_.push_back(r);
    is_known_ = !known_.insert(r.seq).second;
    last_s_ = r.time_s;
    if (advances_.empty() || r.seq > advances_.back().seq) {
      advances_.push_back({r.seq, r.time_s});
      repeated_ = 0;
    }
  }

  /// `r`, late, is the latest of the run.
  void follow_repetition(const Reception& r) {
    const bool counts_up = repeated_ > 0 && r.seq > run_[run_.size() - 2].seq;
    if (!counts_up) repeated_ = repeated_known_ = 0;
    ++repeated_;
    repeated_known_ += is_known_ ? 1 : 0;
    if (repeated_ < kRepeatedRun || 2 * repeated_known_ < repeated_) return;
    const auto begin = run_.end() - static_cast<std::ptrdiff_t>(repeated_);
    const double duration_s = kFaster * (r.time_s - begin->time_s);
    if (steps_between(*begin, r) * interval_s_ > duration_s) return;
    std::vector<Reception> new_run(begin, run_.end());
    run_.erase(begin, run_.end());
    begin_run(std::move(new_run));
  }

  void begin_run(std::vector<Reception> arrivals) {
    end_run(kNewRun);
    for (const Reception& r : arrivals) accept(r);
  }

  /// Ends the run; drops it if it has fewer arrivals than `least`.
  void end_run(std::size_t least) {
    if (run_.size() >= least) {
      result_.runs.push_back(std::move(run_));
    } else {
      result_.implausible += static_cast<std::int64_t>(run_.size());
    }
    run_.clear();
    known_.clear();
    advances_.clear();
    repeated_ = repeated_known_ = 0;
  }

  void drop_candidates() {
    result_.implausible += static_cast<std::int64_t>(candidates_.size());
    candidates_.clear();
  }

  double interval_s_, slack_s_;
  ReceptionRuns result_;
  std::vector<Reception> run_;      // the present one
  std::set<std::int64_t> known_;    // its numbers
  std::vector<Advance> advances_;   // its arrivals with a number higher than any before
  double last_s_ = 0.0;             // its latest arrival
  bool is_known_ = false;           // the latest arrival's number had arrived
  std::size_t repeated_ = 0;        // late arrivals in a row, counting up, and
  std::size_t repeated_known_ = 0;  // repeated packets whose number had arrived
  std::vector<Reception> candidates_;
  bool after_pause_ = false;  // the candidates go on with the run, but for their times
};

/// Believes a sequence number only if it fits the time that has passed since the ones before, as
/// RFC 3550 (appendix A.1) does by numbers alone. With h the median time per number (over
/// neighbours or over 64 arrivals, whichever is less) and a slack J of 2 s or 20 h, whichever is
/// more, an arrival
///
/// - goes on with the run if it is ahead by at most 1 + (3·elapsed + J)/h numbers. If it comes more
///   than J later than its number says, the sender made a pause; the next arrival must confirm it;
/// - is late, or a copy, if it is behind, and the run was past its number for at most J. But 16 in
///   a row that count up from 0 again, as fast as the sender, half of them already known, are no
///   copies: the sender restarted;
/// - begins a new run if two more arrivals go on from it, before any goes on with the old run;
/// - is implausible otherwise: its number or its time is damaged.
///
/// Without a time to tell (all the same), up to 1'000'000 ahead and 1000 behind are believed.
ReceptionRuns divide_into_runs(const std::vector<Reception>& receptions) {
  RunDivider divider(median_interval(receptions));
  for (const Reception& r : receptions) divider.add(r);
  return divider.finish();
}

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
