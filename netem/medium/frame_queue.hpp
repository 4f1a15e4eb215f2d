#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "common/base/time.hpp"

namespace tether {

/// Airtime of one frame.
struct Frame {
  std::uint64_t id = 0;
  Duration air{};            ///< airtime of its data: received at the end of it
  Duration exchange{};       ///< until the medium is idle again, with its acknowledgement
  Duration wasted{};         ///< the same if no receiver can decode it
  bool acknowledged = true;  ///< false: broadcast, sent once
  double error_ratio = 0.0;  ///< share of attempts without a collision that are lost to noise

  // Where the radio decides about each attempt.
  static constexpr int kAnybody = -1;
  int station = kAnybody;  ///< station that sends it, or receives it from the access point
  bool down = false;       ///< from the access point to the station
  int bytes = 0;           ///< with all headers
  double rate_Mbps = 0.0;
  /// Decides about noise, attempt by attempt, whatever other stations do; none: the contender's
  /// stream of noise does.
  std::optional<std::uint64_t> luck{};
};

struct QueueLimits {
  std::size_t frames = 100;             ///< limit, above which frames are refused
  Duration lifetime = Duration::max();  ///< frames that wait for longer are not sent any more
};

/// The frames that wait at one contender.
class FrameQueue {
 public:
  struct Waiting {
    Frame frame;
    Instant since;
  };

  explicit FrameQueue(const QueueLimits& limits) : limits_(limits) {}

  bool push(Instant since, const Frame& frame) {
    if (frames_.size() >= limits_.frames) return false;
    frames_.push_back({frame, since});
    return true;
  }
  bool empty() const { return frames_.empty(); }
  std::size_t size() const { return frames_.size(); }
  const Frame& front() const { return frames_.front().frame; }
  Frame& front() { return frames_.front().frame; }
  /// Whether the frame in front has waited for longer than its lifetime.
  bool front_expired(Instant now) const { return now - frames_.front().since > limits_.lifetime; }
  void pop() { frames_.pop_front(); }
  /// Takes those of a station out.
  std::vector<Waiting> take(int station) {
    std::vector<Waiting> taken;
    std::erase_if(frames_, [station, &taken](const Waiting& waiting) {
      const bool is_its = waiting.frame.station == station;
      if (is_its) taken.push_back(waiting);
      return is_its;
    });
    return taken;
  }

 private:
  QueueLimits limits_;
  std::deque<Waiting> frames_;
};

}  // namespace tether
