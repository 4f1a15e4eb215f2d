#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "netem/medium/frame_queue.hpp"

namespace tether {

/// Handling of the frames of a vehicle that changes its access point: for some time none passes in
/// either direction. Pure: time goes forward only.
class Roaming {
 public:
  struct Rules {
    Duration away{};
    bool waits = true;   ///< frames wait for the end; else they are lost
    QueueLimits limits;  ///< limits of waiting packets, per vehicle and direction
  };
  using Frames = std::vector<FrameQueue::Waiting>;

  explicit Roaming(const Rules& rules) : rules_(rules) {}

  void add_vehicle() { vehicles_.emplace_back(); }

  /// From `now` on it is away, which it was not. `queued`: its frames that were on neither side
  /// yet. Returns those that are lost.
  Frames leave(Instant now, std::size_t vehicle, const Frames& queued);
  bool is_away(std::size_t vehicle) const { return vehicles_[vehicle].until.has_value(); }
  /// False if a frame of a vehicle that is away is lost.
  bool hold(Instant since, std::size_t vehicle, const Frame& frame);

  /// Time when the next roaming vehicle is back; Instant::max() if no vehicle is away.
  Instant next_return() const;
  struct Return {
    Instant at;
    std::size_t vehicle;
    Frames frames, expired;
  };
  /// First vehicle to be back by `now`, which is then not away any more; nullopt: none.
  std::optional<Return> come_back(Instant now);

  struct Counters {
    std::int64_t changes = 0;
    std::int64_t held = 0;  ///< frames that waited
    std::int64_t lost = 0;  ///< frames that did not, or not until the end
  };
  const Counters& counters() const { return counters_; }

 private:
  struct Vehicle {
    std::optional<Instant> until;
    Frames held;
  };
  Rules rules_;
  std::vector<Vehicle> vehicles_;
  std::size_t away_ = 0;
  Counters counters_;
};

}  // namespace tether
