#pragma once

#include <cstddef>
#include <vector>

#include "tools/view/playback/log_index.hpp"
#include "tools/view/playback/playback.hpp"

namespace tether {

/// Says which entries of a log are to be shown when. After a jump these are the latest of each
/// channel before the new position, so that what is seen is the state of that time. Played so fast
/// that more than kMostAtOnce come at once, only the latest of each channel are.
class LogPlayer {
 public:
  static constexpr std::size_t kMostAtOnce = 1000;

  /// At the start of the log, paused. `index` outlives it.
  explicit LogPlayer(const LogIndex& index);

  const Playback& playback() const { return playback_; }
  void play(Instant now);
  void pause(Instant now) { playback_.pause(now); }
  void set_speed(Instant now, double speed) { playback_.set_speed(now, speed); }
  void seek(Instant now, Instant position);

  /// Entries that have become due since the last call, in order.
  std::vector<std::size_t> due(Instant now);

 private:
  const LogIndex& index_;
  Playback playback_;
  std::size_t next_ = 0;
  bool jumped_ = true;
};

}  // namespace tether
