#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>

#include "common/base/time.hpp"

namespace tether {

/// The packet reception ratio of a numbered stream, from the gaps in its numbers: of the last
/// `window` numbers up to the newest that arrived, the share that arrived. 1 before the second one.
/// Losses behind the newest arrival are not seen until the next one.
class ReceptionEstimate {
 public:
  explicit ReceptionEstimate(std::int64_t window) : window_(window) {}

  /// Numbers ascend; a lower one is a stream that restarted, and resets the estimate.
  void add(std::int64_t seq);
  double ratio() const;

 private:
  std::int64_t window_;
  std::int64_t first_ = -1;  ///< number that counting began with
  std::deque<std::int64_t> arrived_;
};

/// How long messages take, from their time stamps: the longest of the last `count`, so that a
/// prediction for the other direction is seldom too short. When a link's delay falls, the estimate
/// follows after `count` messages. Zero before the first one; never negative, whatever the clocks
/// say.
class DelayEstimate {
 public:
  static constexpr std::size_t kFew = 5;  ///< to follow a link that changes

  explicit DelayEstimate(std::size_t count) : count_(count) {}

  void add(Duration delay);
  Duration longest() const;
  /// The median; of two in the middle, the later.
  Duration median() const;

 private:
  std::size_t count_;
  std::deque<Duration> delays_;
};

}  // namespace tether
