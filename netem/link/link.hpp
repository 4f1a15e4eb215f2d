#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/random.hpp"
#include "common/base/time.hpp"
#include "common/scenario/scenario.hpp"
#include "netem/link/channel_process.hpp"
#include "netem/link/delay_histogram.hpp"
#include "netem/link/link_stages.hpp"
#include "netem/link/packet_queue.hpp"

namespace tether {

/// What became of a packet when it was offered, for statistics.
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

/// One direction of the network. A packet that is offered passes these stages:
///   1. outage: during one, nothing enters the link;
///   2. state loss: lost with probability 1 − PRR of what the ChannelProcess says of it;
///   3. independent loss;
///   4. corruption: some bits are flipped;
///   5. duplication: from here on a copy goes the same way, right behind;
///   6. room: dropped if queue_limit packets are under way, or too many bytes with this one;
///   7. rate: waits for a bottleneck, or is dropped at its full queue;
///   8. delay: the process's plus the jitter law's, never negative together; a copy has a jitter of
///      its own;
///   9. order: now and then a packet skips stage 8 (reordering), or none leaves before those
///      offered earlier (in order); with neither, packets overtake each other when delays fall;
///  10. slots: waits for the next release.
///
/// Pure: time and randomness are arguments. Common random numbers: every stage has its own stream
/// and draws a fixed number of times per packet offered, so that the fate of the n-th packet
/// depends on seed, link, n and time, not on the other stages, nor on who sends or listens.
class Link {
 public:
  /// offered + duplicated = outage_dropped + lost + overflowed + delivered + in_flight, always.
  struct Counters {
    std::int64_t offered = 0;
    std::int64_t duplicated = 0;  ///< copies made
    std::int64_t outage_dropped = 0;
    std::int64_t lost = 0;        ///< by the state or independently
    std::int64_t overflowed = 0;  ///< no room in the link or before the bottleneck
    std::int64_t delivered = 0;
    std::int64_t delivered_bytes = 0;
    // Of those that got through stage 3:
    std::int64_t corrupted = 0;
    std::int64_t reordered = 0;
  };
  using Observer = std::function<void(const PacketFate&)>;

  /// `process` may be shared between links. `config`: its stages; the model is the process's
  /// matter. `delay_table_ms`: load_delay_table(config.jitter).
  Link(const LinkConfig& config, std::shared_ptr<ChannelProcess> process,
       const LinkStreams& streams, const std::vector<double>& delay_table_ms = {});

  /// Other settings, ready for apply(): all that can fail has been done.
  struct Change {
    LinkStages stages;
    std::shared_ptr<ChannelProcess> process;
  };
  /// `process` is what decides the conditions from then on, the present one if that stays. The rest
  /// as for the constructor; `delay_table_ms` is used only if config.jitter becomes another.
  Change prepare(const LinkConfig& config, std::shared_ptr<ChannelProcess> process,
                 const LinkStreams& streams, const std::vector<double>& delay_table_ms) const;

  /// From the next packet on, other settings. `change` was prepared since the latest push().
  ///
  /// Packets under way stay so and leave when they would have left; counters, delays and the
  /// numbers of packets go on. The luck of the n-th packet in each stage stays a function of seed,
  /// link and n, and the state of a process in time one of seed, t and the settings at t: runs that
  /// differ in their changes meet the same network where they have the same settings. Only what
  /// remembers packets (LinkStages::renewed(), processes per packet) depends on earlier settings.
  /// With in_order no packet overtakes those that are under way, whatever they were offered under.
  void apply(Change change);

  /// Returns when the packet leaves; Instant::max() if it never does.
  Instant push(Instant now, Packet packet);

  /// When the copy of the packet that was pushed last leaves; Instant::max() if there is none.
  Instant copy_departure() const { return copy_departure_; }

  /// When the next packet leaves; Instant::max() if none is under way.
  Instant next_event() const { return queue_.next_departure(); }

  /// Hands over every packet due by `now`, in order of departure, then of arrival.
  void pop_ready(Instant now, const std::function<void(const Packet&)>& deliver);

  /// Is told each packet's fate from now on, at the end of push().
  void set_observer(Observer observer) { observer_ = std::move(observer); }

  const Counters& counters() const { return counters_; }
  std::int64_t in_flight() const { return static_cast<std::int64_t>(queue_.size()); }
  /// Sojourn times of the delivered packets, copies included.
  const DelayHistogram& delays() const { return delays_; }
  ChannelProcess& process() { return *process_; }
  const ChannelProcess& process() const { return *process_; }

 private:
  using Luck = LinkStages::Luck;
  PacketFate::Outcome entry(Instant now, const Luck& luck) const;
  std::optional<Instant> send(Instant now, Duration delay, Packet&& packet);

  LinkStages stages_;
  std::shared_ptr<ChannelProcess> process_;
  Instant latest_departure_ = Instant::min();
  Instant copy_departure_ = Instant::max();
  PacketQueue queue_;
  Counters counters_;
  DelayHistogram delays_;
  Observer observer_;
};

}  // namespace tether
