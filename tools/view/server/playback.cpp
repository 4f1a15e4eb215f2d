#include "tools/view/server/playback.hpp"

#include <algorithm>
#include <cassert>

namespace tether {

Instant Playback::position(Instant now) const {
  if (!playing_) return position_;
  const double played_s = to_seconds(now - since_) * speed_;
  if (played_s >= to_seconds(end_ - position_)) return end_;
  return position_ + from_seconds(played_s);
}

// From here on the position is reckoned from `now`.
void Playback::hold(Instant now) {
  position_ = position(now);
  since_ = now;
}

void Playback::play(Instant now) {
  hold(now);
  if (position_ == end_) position_ = start_;
  playing_ = true;
}

void Playback::pause(Instant now) {
  hold(now);
  playing_ = false;
}

void Playback::set_speed(Instant now, double speed) {
  assert(speed >= kSlowest && speed <= kFastest);
  hold(now);
  speed_ = speed;
}

void Playback::seek(Instant now, Instant position) {
  hold(now);
  position_ = std::clamp(position, start_, end_);
}

}  // namespace tether
