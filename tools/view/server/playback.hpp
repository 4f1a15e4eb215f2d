#pragma once

#include "common/base/time.hpp"

namespace tether {

/// Which place of a recording is shown at which time: play, pause, other speeds, jumps. `now` is a
/// clock that never steps back; times of the recording are positions.
class Playback {
 public:
  static constexpr double kSlowest = 0.1, kFastest = 100.0;

  /// Paused at the start. start <= end.
  Playback(Instant start, Instant end) : start_(start), end_(end), position_(start) {}

  Instant start() const { return start_; }
  Instant end() const { return end_; }
  double speed() const { return speed_; }

  /// In [start, end].
  Instant position(Instant now) const;
  /// False once it has come to its end.
  bool playing(Instant now) const { return playing_ && position(now) < end_; }

  /// From the start again, if it stands at the end.
  void play(Instant now);
  void pause(Instant now);
  /// Recorded seconds per second, in [kSlowest, kFastest].
  void set_speed(Instant now, double speed);
  /// Kept within [start, end]; it goes on playing if it does.
  void seek(Instant now, Instant position);

 private:
  void hold(Instant now);

  Instant start_, end_;
  Instant position_;  ///< at since_
  Instant since_{};
  double speed_ = 1.0;
  bool playing_ = false;
};

}  // namespace tether
