#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "common/base/counters.hpp"
#include "common/base/time.hpp"
#include "common/vehicle/actuator_policy.hpp"
#include "common/vehicle/pose.hpp"
#include "controller/laws/law.hpp"
#include "controller/laws/network_estimate.hpp"
#include "controller/laws/pose_filter.hpp"

namespace tether {

/// Chance that a twist arrives, by whether the one before it did: a chain of two states, the
/// simplest channel with bursts. Without bursts both are the packet reception ratio.
///
/// It is that of poses, of which the numbers tell; and the odds of both differ by a factor that is
/// learned from what the vehicle does.
class ArrivalChance {
 public:
  enum Before { kLost, kArrived };

  /// A pose with this number arrived. A lower one than the last is of a stream that restarted.
  void heard(std::int64_t seq);
  /// The derivative of the log-likelihood of a pose by the logarithm of that factor.
  void learn(double score);
  double of(Before before) const;

 private:
  static constexpr double kPrior = 2.0;  ///< variance of log_factor_ before it is learned

  void count(Before before, double arrived, double of);

  std::int64_t last_ = -1;
  std::array<double, 2> arrived_{}, of_{};  ///< poses by Before
  double log_factor_ = 0.0, variance_ = kPrior;
};

/// Estimates where a vehicle is that follows twists of which some are lost, and nothing tells
/// which: a mixture of PoseFilters, one for each sent twist that may be the one in force.
///
/// The twist in force is a hidden discrete state. When a sent twist is due at the vehicle, every
/// filter divides: with the chance that it was lost nothing changes; else it takes over. Those in
/// which it takes over become one, of the mean and the covariance that they had together (as in the
/// interacting multiple model filter of Blom and Bar-Shalom, IEEE Trans. Automatic Control 33,
/// 1988), so there are never more filters than twists, nor more than kMost. A pose corrects each
/// filter, and their weights by how likely it made that pose.
///
/// The delay of a twist is drawn from the delays of the last poses: with one value if they are
/// equal, else with three that have their mean and variance. For the chance to arrive, each filter
/// carries how many twists more than expected arrived in its own past, on average; by how much a
/// pose changes the mean of that over all filters is the score of the chance (Fisher's identity:
/// Cappé, Moulines, Rydén: Inference in Hidden Markov Models. Springer, 2005, section 10.1; not
/// consulted). What the vehicle does when twists stay out is its actuator's policy.
///
/// NIS, gate and resets are those of the mixture's mean and covariance. A pose is gated only if
/// none of the filters makes it likely, either.
///
/// Pure, as PoseFilter.
class SentTwistFilter {
 public:
  static constexpr std::size_t kMost = 16;

  SentTwistFilter(const LawSettings& settings, const MotionModel::Limits& limits);

  /// A twist was sent at `now`, which ascends.
  void send(Instant now, const Twist& twist);
  /// A pose arrived: what it says about the network. `delay`: its own in the network.
  void hear(std::int64_t seq, Duration delay);
  /// The vehicle moves on to `until`; not back.
  void advance(Instant until);
  /// The vehicle moved on to `until` by what its wheels rolled, whatever was in force; with that,
  /// the pose is known in all filters. Their weights change by how likely each made the
  /// speeds of the wheels at the end.
  void roll(const Rolled& rolled, Instant until);
  void widen(double position_m);
  /// A pose measured now. It must be finite.
  PoseFilter::Verdict update(const Pose2& measured);

  /// Mean and covariance of the mixture.
  const PoseFilter& mean() const { return mean_; }
  /// Chance that the next twist arrives if the last did, and if it did not.
  double chance(ArrivalChance::Before before) const { return chance_.of(before); }
  std::size_t filters() const { return filters_.size(); }
  void list_counters(CounterList& out) const { mean_.list_counters(out); }

 private:
  static constexpr std::size_t kMostSent = 10000;  ///< without poses for long
  static constexpr std::size_t kDelays = 20;
  struct Sent {
    Instant when;
    Twist twist;
    int trials = 0;  ///< times at which it may arrive; 0 before the first
    int tried = 0;
  };
  struct Filter {
    PoseFilter filter;
    double weight = 1.0;
    std::int64_t number = -1;  ///< number of the twist in force; −1: none was sent
    Twist twist;
    Instant since = Instant::min();  ///< it arrived, on average
    double surplus = 0.0;            ///< twists that arrived minus those expected to
  };
  struct Due {
    std::size_t sent;
    Instant when;
  };

  std::optional<Due> next_due() const;
  Instant due(const Sent& sent) const;
  void arrive(std::size_t i, Instant when);
  Twist in_force(const Filter& f, Instant when) const;
  void move(Filter& f, Instant until) const;
  void join(Filter& into, const Filter& other) const;
  double apart(const Filter& a, const Filter& b) const;
  void thin_out();
  void take_mean();
  double surplus() const;

  ActuatorSettings actuator_;
  const ActuatorPolicy* policy_;
  StopLimits stop_;
  Duration timeout_;
  std::deque<Sent> sent_;
  std::int64_t first_sent_ = 0;  ///< number of the first in sent_
  std::deque<Duration> delays_;
  Duration delay_{}, delay_spread_{};
  ArrivalChance chance_;
  std::vector<Filter> filters_;  ///< numbers ascend
  Instant at_ = kStart;          ///< the vehicle stands until then
  PoseFilter mean_;
};

}  // namespace tether
