#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/base/random.hpp"
#include "common/base/time.hpp"
#include "netem/medium/frame_queue.hpp"

namespace tether {

/// How stations share the air: IEEE 802.11-2016, 10.3 (DCF) and 10.22.2 (EDCA).
struct ContentionRules {
  /// Rule for a station's backoff counter in a slot in which another station transmits.
  enum class Countdown {
    idle_slots,      ///< DCF, 10.3.4.3: nothing; it counts whole idle slots only
    slot_boundaries  ///< EDCA, 10.22.2.4, and Bianchi's model: that slot counts, too
  };
  Duration slot{};
  Duration sifs{};
  Countdown countdown = Countdown::slot_boundaries;
};

/// How one access category of a station contends; 802.11-2016, table 9-137.
struct AccessParameters {
  int cw_min = 15;    ///< counters are drawn from 0 … cw, which doubles (2·cw + 1) up to …
  int cw_max = 1023;  ///< … this with each failure
  int aifsn = 2;      ///< slots after SIFS before it counts or transmits; DCF: 2
  std::int64_t attempts = 7;  ///< maximum attempts of a frame, then it is dropped; 0: no limit
};

/// Result of a frame at the end of its last attempt.
struct FrameEnd {
  std::uint64_t id = 0;
  bool delivered = false;
  Instant at{};      ///< its data's end in the air; of one that was dropped: of its last attempt
  int attempts = 0;  ///< 0: it was dropped unsent, because its lifetime was over
};

/// A radio medium on which all stations hear each other, exact to the slot: one event a
/// transmission, not one a slot.
///
/// Each *contender* is a queue of one access category of one station. Its counter is frozen while
/// the medium is busy. Contenders of different stations whose counters end in the same slot
/// collide; of one station, the one that was added first transmits, and the others do as if they
/// had collided. After each frame, delivered or dropped, a new counter is drawn even if no frame
/// waits (post-backoff); a frame that finds the medium idle and the counter at zero goes at the
/// next slot boundary.
///
/// Pure: time goes forward only, from call to call. Each contender has random streams of its own
/// for backoff and noise, so that adding one changes no other's draws.
class Contention {
 public:
  using Ended = std::function<void(const FrameEnd&)>;
  /// Changes what a frame takes of the medium, and how noise treats it, to how that is now.
  using Renew = std::function<void(Frame&)>;
  /// Error probability of one of several frames that are in the air at once: its error ratio; 1: it
  /// is lost.
  using Capture = std::function<double(std::span<const Frame> frames, std::size_t which)>;

  Contention(const ContentionRules& rules, std::uint64_t seed, Ended ended);

  /// Returns its number, from 0 on. Contenders of one station: most urgent first. `name`: of its
  /// random stream of backoff; that of noise is "<name>/noise".
  std::size_t add(int station, const AccessParameters& access, const QueueLimits& limits,
                  const std::string& name);

  /// Asked before each attempt; without, frames stay what they were when they were pushed.
  void set_renew(Renew renew) { renew_ = std::move(renew); }
  /// Without, all that collide are lost.
  void set_capture(Capture capture) { capture_ = std::move(capture); }

  /// All transmissions that begin before `now`.
  void catch_up(Instant now);

  /// False if its queue is full. Transmissions that begin before `now` take place first.
  bool push(Instant now, std::size_t contender, const Frame& frame) {
    return push(now, contender, {frame, now});
  }
  /// One that has waited elsewhere.
  bool push(Instant now, std::size_t contender, const FrameQueue::Waiting& waiting);
  /// Takes what waits of a station's frames out of the queue; none of them ends.
  std::vector<FrameQueue::Waiting> take(Instant now, std::size_t contender, int station);

  /// From now on the contender always has a frame like this one; its id is not reported.
  void saturate(Instant now, std::size_t contender, const Frame& frame);

  /// When the next transmission begins; Instant::max() if no station has a frame.
  Instant next_event() const;
  /// All transmissions that begin by `now`.
  void advance(Instant now);

  struct Counters {
    std::int64_t transmissions = 0;  ///< busy times of the medium
    std::int64_t collisions = 0;     ///< transmissions of several stations at once
    std::int64_t attempts = 0;       ///< frames in the air, of all stations
    std::int64_t collided = 0;       ///< frames in a collision
    std::int64_t captured = 0;       ///< collided frames that were received all the same
    std::int64_t delivered = 0;
    std::int64_t corrupted = 0;  ///< attempts lost to the radio, without a collision
    std::int64_t dropped = 0;    ///< after all attempts
    std::int64_t expired = 0;    ///< lifetime over before the first attempt
    std::int64_t overflowed = 0;
    Duration busy{};  ///< busy time of the medium, in all
  };
  const Counters& counters() const { return counters_; }
  /// Frames of one contender that were delivered.
  std::int64_t delivered(std::size_t contender) const { return contenders_[contender].delivered; }
  /// Frames that wait or are in the air.
  std::size_t waiting(std::size_t contender) const { return contenders_[contender].queue.size(); }

 private:
  struct Contender {
    int station;
    AccessParameters access;
    int cw;
    int attempts = 0;  ///< attempts of the frame in front
    std::int64_t delivered = 0;
    FrameQueue queue;
    std::optional<Frame> endless;
    RandomEngine backoff;
    RandomEngine noise;
  };

  static Frame& front(Contender& c) { return c.endless ? *c.endless : c.queue.front(); }
  bool has_frame(const Contender& c) const { return c.endless || !c.queue.empty(); }
  Instant boundary(std::int32_t slot) const {
    return idle_since_ + rules_.sifs + slot * rules_.slot;
  }
  void draw(std::size_t i);
  void show(std::size_t i);
  void join(Instant now, std::size_t i);
  void transmit(std::int32_t slot);
  void put_on_air();
  static double noise_of(Contender& c, const Frame& frame);
  double errors_among(std::size_t which) const;
  void freeze(std::int32_t slot);
  void succeed(std::size_t i, Instant start);
  void fail(std::size_t i, Instant start, bool was_sent);
  void next_frame(std::size_t i, Instant now);

  ContentionRules rules_;
  std::uint64_t seed_;
  Ended ended_;
  Renew renew_;
  Capture capture_;
  std::vector<Contender> contenders_;
  // By contender, apart from the rest, because each transmission passes over all of them.
  std::vector<std::int32_t> zero_at_;  ///< the slot, since the medium is idle, of the counter's end
  std::vector<std::int32_t> goes_at_;  ///< the same, if it has a frame
  std::vector<std::int32_t> aifsn_;
  std::vector<char> untouched_;  ///< at zero without a draw: may go at once, draws if it cannot
  std::int32_t first_;           ///< the least of goes_at_
  // State of the present transmission.
  std::vector<std::size_t> sending_;
  std::vector<std::size_t> in_air_;  ///< present frames of those stations
  std::vector<Frame> frames_;        ///< their frames, if one may be captured
  Instant idle_since_ = kStart;      ///< or busy until then
  Counters counters_;
};

}  // namespace tether
