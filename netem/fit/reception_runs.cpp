#include "netem/fit/reception_runs.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

namespace tether {
namespace {

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

  /// A run of fewer arrivals than `least` is none.
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

}  // namespace

ReceptionRuns divide_into_runs(const std::vector<Reception>& receptions) {
  RunDivider divider(median_interval(receptions));
  for (const Reception& r : receptions) divider.add(r);
  return divider.finish();
}

}  // namespace tether
