#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <memory>
#include <string_view>
#include <vector>

#include "common/base/random.hpp"
#include "common/base/time.hpp"
#include "netem/link/channel_process.hpp"
#include "netem/link/packet_queue.hpp"

namespace tether {

/// A random stream of one link for one purpose, such as "loss".
using LinkStreams = std::function<RandomEngine(std::string_view purpose)>;

/// Fate of a packet at the time it was offered, for statistics.
struct PacketFate {
  enum class Outcome { under_way, outage, lost, overflowed };

  std::int64_t number = 0;  ///< from 0, of those offered to the link
  Instant arrival;
  Outcome outcome = Outcome::under_way;
  Instant departure = Instant::max();  ///< under_way: when it leaves
  int state = 0;                       ///< ChannelProcess::state() after on_packet()
  bool corrupted = false;
  bool duplicated = false;  ///< a copy got into the link as well
  bool reordered = false;   ///< skipped its delay
};

/// A packet that is offered to a link, with what the stages so far have made of it.
struct OfferedPacket {
  Packet& packet;
  LinkCondition condition;  ///< condition of the channel
  PacketFate fate;
  bool copied = false;  ///< a copy goes the same way

  bool goes_on() const { return fate.outcome == PacketFate::Outcome::under_way; }
  void lose() {
    if (goes_on()) fate.outcome = PacketFate::Outcome::lost;
  }
};

/// A packet that has not been lost, or its copy, on its way to the queue of those under way.
struct Passage {
  Instant now;  ///< when it was offered
  std::size_t bytes = 0;
  const PacketQueue& under_way;
  Instant sent;      ///< when its delay begins: `now` or, behind a bottleneck, later
  Duration delay;    ///< the channel's and what stages add; below 0 it counts as 0
  bool skips_delay;  ///< PacketFate::reordered
  bool is_copy;
  Instant not_before = Instant::min();

  /// When it leaves, as far as the stages so far decide.
  Instant departure() const {
    const Duration after = skips_delay ? Duration{0} : std::max(Duration{0}, delay);
    return std::max(not_before, sent + after);
  }
};

/// A stage of a link. Pure: its randomness is a stream of its own, from which it draws a fixed
/// number of times for each packet offered, whatever has become of the packet: the n-th packet has
/// the same luck in a stage whichever other stages are on.
class LinkStage {
 public:
  LinkStage() = default;
  LinkStage& operator=(const LinkStage&) = delete;
  virtual ~LinkStage() = default;

  /// Meets each packet that is offered, in order, also those that stages before have lost. May lose
  /// the packet, damage it or ask for a copy.
  virtual void meet(OfferedPacket&) {}

  /// Then, when all stages have met the packet and none has lost it: once for the packet and once
  /// for its copy. May put off the departure. False if there is no room.
  virtual bool pass(Passage&) { return true; }

 protected:
  LinkStage(const LinkStage&) = default;
};

using StagePtr = std::unique_ptr<LinkStage>;

/// Enabled stages, in the order in which packets pass them.
using LinkStages = std::vector<StagePtr>;

}  // namespace tether
