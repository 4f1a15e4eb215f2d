#include "netem/medium/roaming.hpp"

#include <algorithm>
#include <cassert>
#include <utility>

namespace tether {

Roaming::Frames Roaming::leave(Instant now, std::size_t vehicle, const Frames& queued) {
  Vehicle& v = vehicles_[vehicle];
  ++counters_.changes;
  assert(!v.until);
  ++away_;
  v.until = now + rules_.away;
  Frames lost;
  for (const FrameQueue::Waiting& waiting : queued) {
    if (!hold(waiting.since, vehicle, waiting.frame)) lost.push_back(waiting);
  }
  return lost;
}

bool Roaming::hold(Instant since, std::size_t vehicle, const Frame& frame) {
  Frames& held = vehicles_[vehicle].held;
  const auto same_way = std::count_if(held.begin(), held.end(), [&frame](const auto& other) {
    return other.frame.down == frame.down;
  });
  if (!rules_.waits || static_cast<std::size_t>(same_way) >= rules_.limits.frames) {
    ++counters_.lost;
    return false;
  }
  ++counters_.held;
  held.push_back({frame, since});
  return true;
}

Instant Roaming::next_return() const {
  Instant next = Instant::max();
  if (away_ == 0) return next;
  for (const Vehicle& v : vehicles_) next = std::min(next, v.until.value_or(next));
  return next;
}

std::optional<Roaming::Return> Roaming::come_back(Instant now) {
  const Instant at = next_return();
  if (away_ == 0 || at > now) return std::nullopt;
  const auto first = std::find_if(vehicles_.begin(), vehicles_.end(),
                                  [at](const Vehicle& v) { return v.until == at; });
  Return back{at, static_cast<std::size_t>(first - vehicles_.begin()), {}, {}};
  for (const FrameQueue::Waiting& waiting : std::exchange(first->held, {})) {
    const bool expired = at - waiting.since > rules_.limits.lifetime;
    if (expired) ++counters_.lost;
    (expired ? back.expired : back.frames).push_back(waiting);
  }
  first->until.reset();
  --away_;
  return back;
}

}  // namespace tether
