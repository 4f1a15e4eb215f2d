#include "controller/laws/sent_twist_filter.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace tether {
namespace {

/// Counts of poses are of about this many of the last.
constexpr double kFading = 200.0;
/// A factor that was learned is forgotten within about this many poses.
constexpr double kForgets = 1000.0;
/// Arrivals in the past of a filter count for about this many twists.
constexpr double kPast = 40.0;
/// Below this weight a filter is joined with its neighbour.
constexpr double kTiny = 1e-4;
/// Delays that differ less, by their standard deviation, count as equal.
constexpr Duration kSameDelay = std::chrono::milliseconds{1};

/// Difference of rims to what a filter expects: noise, slip, and when exactly a twist took over.
constexpr double kRimNoise_mps = 0.1;
/// Wheels may do what no sent twist explains.
constexpr double kUnlikely = 1e-3;

/// Standard deviation of three values of equal weight, one of them in the middle.
const double kThird = std::sqrt(1.5);

Duration mean_of(const std::deque<Duration>& values) {
  return std::accumulate(values.begin(), values.end(), Duration{0}) /
         static_cast<std::int64_t>(values.size());
}

Duration deviation_of(const std::deque<Duration>& values) {
  const Duration mean = mean_of(values);
  double sum_s2 = 0.0;
  for (const Duration& v : values) sum_s2 += std::pow(to_seconds(v - mean), 2);
  return from_seconds(std::sqrt(sum_s2 / static_cast<double>(values.size())));
}

}  // namespace

void ArrivalChance::count(Before before, double arrived, double of) {
  const double left = std::pow(1.0 - 1.0 / kFading, of);
  for (double& n : arrived_) n *= left;
  for (double& n : of_) n *= left;
  arrived_[before] += arrived;
  of_[before] += of;
}

void ArrivalChance::heard(std::int64_t seq) {
  if (last_ >= 0 && seq > last_) {
    const auto lost = static_cast<double>(seq - last_ - 1);
    count(kArrived, lost == 0.0 ? 1.0 : 0.0, 1.0);
    if (lost > 0.0) count(kLost, 1.0, lost);
  }
  last_ = seq;
}

void ArrivalChance::learn(double score) {
  variance_ = 1.0 / (1.0 / variance_ + score * score);
  log_factor_ += variance_ * score;
  log_factor_ -= log_factor_ / kForgets;
  variance_ += (kPrior - variance_) / kForgets;
}

double ArrivalChance::of(Before before) const {
  // Few poses with one past: as those with the other. None at all: one half.
  const double all = (arrived_[0] + arrived_[1] + 1.0) / (of_[0] + of_[1] + 2.0);
  const double poses = (arrived_[before] + 2.0 * all) / (of_[before] + 2.0);
  return 1.0 / (1.0 + (1.0 - poses) / poses * std::exp(-log_factor_));
}

SentTwistFilter::SentTwistFilter(const LawSettings& settings, const MotionModel::Limits& limits)
    : actuator_(settings.get<ActuatorSettings>()),
      policy_(&kind_of(actuator_)),
      stop_(stop_limits(actuator_, settings.get<VehicleSettings>())),
      timeout_(from_seconds(actuator_.timeout_s)),
      mean_(settings.get<ControllerSettings>().ekf, {}, limits,
            settings.get<VehicleSettings>().start_pose()) {
  filters_.push_back({.filter = mean_, .twist = {}});
}

void SentTwistFilter::send(Instant now, const Twist& twist) {
  sent_.push_back({now, twist});
  if (sent_.size() <= kMostSent) return;
  sent_.pop_front();
  ++first_sent_;
}

void SentTwistFilter::hear(std::int64_t seq, Duration delay) {
  chance_.heard(seq);
  delays_.push_back(std::max(delay, Duration{0}));
  if (delays_.size() > kDelays) delays_.pop_front();
  delay_ = mean_of(delays_);
  delay_spread_ = deviation_of(delays_);
}

/// When the next trial of a twist is due.
Instant SentTwistFilter::due(const Sent& sent) const {
  const bool same_delay = sent.trials == 1 || (sent.trials == 0 && delay_spread_ < kSameDelay);
  if (same_delay) return sent.when + delay_;
  const double apart = kThird * (sent.tried - 1);
  return sent.when +
         std::max(Duration{0}, delay_ + from_seconds(apart * to_seconds(delay_spread_)));
}

std::optional<SentTwistFilter::Due> SentTwistFilter::next_due() const {
  std::optional<Due> next;
  for (std::size_t i = 0; i < sent_.size(); ++i) {
    if (sent_[i].trials > 0 && sent_[i].tried == sent_[i].trials) continue;
    const Instant when = std::max(at_, due(sent_[i]));
    if (!next || when < next->when) next = Due{i, when};
  }
  return next;
}

void SentTwistFilter::advance(Instant until) {
  if (until <= at_) return;
  while (const auto next = next_due()) {
    if (next->when >= until) break;
    for (Filter& f : filters_) move(f, next->when);
    at_ = next->when;
    arrive(next->sent, next->when);
    while (!sent_.empty() && sent_.front().trials > 0 &&
           sent_.front().tried == sent_.front().trials) {
      sent_.pop_front();
      ++first_sent_;
    }
  }
  for (Filter& f : filters_) move(f, until);
  at_ = until;
  take_mean();
}

/// Returns what the vehicle does at `when` if the filter is right about the last twist.
Twist SentTwistFilter::in_force(const Filter& f, Instant when) const {
  if (policy_->after_timeout == nullptr || f.number < 0 || when < f.since + timeout_) {
    return f.twist;
  }
  return policy_->after_timeout(f.twist, when - f.since - timeout_, actuator_, stop_);
}

void SentTwistFilter::move(Filter& f, Instant until) const {
  const Duration step = from_seconds(MotionModel::kShort_s);
  for (Instant at = at_; at < until;) {
    const bool stays = policy_->after_timeout == nullptr || f.number < 0;
    const Instant over = stays ? until : f.since + timeout_;
    if (at >= over) {
      const Twist twist = in_force(f, at + step / 2);
      const Instant end = stands_still(twist) ? until : std::min(until, at + step);
      f.filter.advance(twist, to_seconds(end - at));
      at = end;
    } else {
      const Instant end = std::min(until, over);
      f.filter.advance(f.twist, to_seconds(end - at));
      at = end;
    }
  }
}

/// A trial of a sent twist: in each filter with an older one it may arrive now.
void SentTwistFilter::arrive(std::size_t i, Instant when) {
  Sent& sent = sent_[i];
  if (sent.trials == 0) sent.trials = delay_spread_ < kSameDelay ? 1 : 3;
  const double now = 1.0 / sent.trials;
  const double before = sent.tried * now;
  ++sent.tried;
  const bool last = sent.tried == sent.trials;
  const std::int64_t number = first_sent_ + static_cast<std::int64_t>(i);
  const double chances[] = {chance(ArrivalChance::kLost), chance(ArrivalChance::kArrived)};
  std::optional<Filter> taken;
  std::size_t later = 0;  // the first filter with this twist or a newer one
  for (; later < filters_.size() && filters_[later].number < number; ++later) {
    Filter& f = filters_[later];
    const auto past = f.number == number - 1 ? ArrivalChance::kArrived : ArrivalChance::kLost;
    const double chance = chances[past] * now / (1.0 - chances[past] * before);
    Filter received = f;
    received.weight *= chance;
    received.number = number;
    received.twist = sent.twist;
    received.since = when;
    received.surplus = (1.0 - 1.0 / kPast) * f.surplus + 1.0 - chances[past];
    f.weight *= 1.0 - chance;
    if (last) f.surplus = (1.0 - 1.0 / kPast) * f.surplus - chances[past];
    if (taken) {
      join(*taken, received);
    } else {
      taken = received;
    }
  }
  if (taken && later < filters_.size() && filters_[later].number == number) {
    join(filters_[later], *taken);
  } else if (taken) {
    filters_.insert(filters_.begin() + static_cast<std::ptrdiff_t>(later), *taken);
  }
  thin_out();
}

/// Joins two filters; the twist in force is that of the heavier one.
void SentTwistFilter::join(Filter& into, const Filter& other) const {
  const double weight = into.weight + other.weight;
  if (!(weight > 0.0)) return;
  const double share = other.weight / weight;
  into.filter.mix(other.filter, share);
  into.surplus += share * (other.surplus - into.surplus);
  if (into.number == other.number) {
    into.since += from_seconds(share * to_seconds(other.since - into.since));
  } else if (share > 0.5) {
    into.number = other.number;
    into.twist = other.twist;
    into.since = other.since;
  }
  into.weight = weight;
}

/// How much is lost by joining two filters: their weight, times how far apart they are and will be.
double SentTwistFilter::apart(const Filter& a, const Filter& b) const {
  const MotionModel::State &at = a.filter.state(), &bt = b.filter.state();
  const double x_m = at.pose.x_m - bt.pose.x_m, y_m = at.pose.y_m - bt.pose.y_m;
  const double yaw_rad = wrap_angle(at.pose.yaw_rad - bt.pose.yaw_rad);
  const auto wheels = [&](const WheelSpeeds& l, const WheelSpeeds& r) {
    return std::pow(l.left_mps - r.left_mps, 2) + std::pow(l.right_mps - r.right_mps, 2);
  };
  const MotionModel& model = a.filter.model();
  const double squares = x_m * x_m + y_m * y_m + yaw_rad * yaw_rad + wheels(at.rim, bt.rim) +
                         wheels(model.rim_of(in_force(a, at_)), model.rim_of(in_force(b, at_)));
  return a.weight * b.weight / (a.weight + b.weight) * squares;
}

/// Joins neighbours: one of no weight; then, while there are too many, those that are least apart.
void SentTwistFilter::thin_out() {
  for (std::size_t i = 0; i < filters_.size() && filters_.size() > 1;) {
    if (filters_[i].weight >= kTiny) {
      ++i;
      continue;
    }
    const std::size_t next = i + 1 < filters_.size() ? i + 1 : i - 1;
    join(filters_[next], filters_[i]);
    filters_.erase(filters_.begin() + static_cast<std::ptrdiff_t>(i));
  }
  while (filters_.size() > kMost) {
    std::size_t least = 0;
    double least_apart = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i + 1 < filters_.size(); ++i) {
      const double cost = apart(filters_[i], filters_[i + 1]);
      if (cost < least_apart) {
        least = i;
        least_apart = cost;
      }
    }
    join(filters_[least + 1], filters_[least]);
    filters_.erase(filters_.begin() + static_cast<std::ptrdiff_t>(least));
  }
}

void SentTwistFilter::roll(const Rolled& rolled, Instant until) {
  if (until <= at_) return;
  PoseFilter moved = mean_;
  moved.roll(rolled, to_seconds(until - at_));
  advance(until);
  double most = -std::numeric_limits<double>::infinity();
  std::vector<double> likely;
  for (const Filter& f : filters_) {
    const WheelSpeeds &a = f.filter.state().rim, &b = moved.state().rim;
    const double apart_mps2 =
        std::pow(a.left_mps - b.left_mps, 2) + std::pow(a.right_mps - b.right_mps, 2);
    likely.push_back(-0.5 * apart_mps2 / (kRimNoise_mps * kRimNoise_mps));
    most = std::max(most, likely.back());
  }
  double sum = 0.0;
  for (std::size_t i = 0; i < filters_.size(); ++i) {
    filters_[i].filter.take(moved);
    filters_[i].weight *= std::exp(likely[i] - most) + kUnlikely;
    sum += filters_[i].weight;
  }
  for (Filter& f : filters_) f.weight /= sum;
  thin_out();
  mean_ = moved;
  take_mean();
}

void SentTwistFilter::widen(double position_m) {
  for (Filter& f : filters_) f.filter.widen(position_m);
  take_mean();
}

void SentTwistFilter::take_mean() {
  mean_.take(filters_.front().filter);
  double weight = 0.0;
  for (const Filter& f : filters_) {
    weight += f.weight;
    mean_.mix(f.filter, f.weight / weight);
  }
}

double SentTwistFilter::surplus() const {
  double sum = 0.0, weight = 0.0;
  for (const Filter& f : filters_) {
    sum += f.weight * f.surplus;
    weight += f.weight;
  }
  return sum / weight;
}

PoseFilter::Verdict SentTwistFilter::update(const Pose2& measured) {
  std::vector<PoseFilter::Fit> fits;
  bool likely = false;
  for (const Filter& f : filters_) {
    fits.push_back(f.filter.fit(measured));
    likely |= fits.back().nis <= PoseFilter::kGate;
  }
  const PoseFilter::Verdict verdict = mean_.update(measured, !likely);
  if (verdict == PoseFilter::Verdict::gated) return verdict;
  if (verdict == PoseFilter::Verdict::reset) {
    for (Filter& f : filters_) f.filter.restart(measured, f.filter.state().rim);
    take_mean();
    return verdict;
  }
  const auto best = std::max_element(fits.begin(), fits.end(), [](const auto& a, const auto& b) {
    return a.log_likelihood < b.log_likelihood;
  });
  const double before = surplus();
  double sum = 0.0;
  for (std::size_t i = 0; i < fits.size(); ++i) {
    filters_[i].filter.correct(measured);
    filters_[i].weight *= std::exp(fits[i].log_likelihood - best->log_likelihood);
    sum += filters_[i].weight;
  }
  for (Filter& f : filters_) f.weight /= sum;
  chance_.learn(surplus() - before);
  thin_out();
  take_mean();
  return verdict;
}

}  // namespace tether
