#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "common/base/time.hpp"
#include "netem/link/channel_process.hpp"
#include "netem/link/delay_bins.hpp"
#include "netem/link/link_stage.hpp"
#include "netem/link/packet_queue.hpp"

namespace tether {

/// Quantiles of delays in bounded memory. Bins are 1/64 of their value wide, and each keeps the
/// mean of what fell into it: a constant delay is reported exactly, others within 1.6 %.
class DelayHistogram {
 public:
  /// Negative delays count as zero.
  void add(Duration delay);

  /// The smallest bin's mean below or at which a share `q` (0..1) of the delays lies; zero if there
  /// are none.
  Duration quantile(double q) const;
  /// Zero if there are none.
  Duration mean() const;
  Duration max() const { return max_; }
  std::int64_t count() const { return count_; }

 private:
  struct Bin {
    std::int64_t count = 0;
    std::int64_t sum_ns = 0;
  };
  DelayBins<Bin, 7> bins_;
  std::int64_t count_ = 0;
  double sum_ns_ = 0.0;
  Duration max_{0};
};

/// One direction of the network: a channel, whose conditions packets meet, the stages that they
/// pass (netem/stages/kinds.hpp has their order), and the queue of packets under way.
///
/// Pure: time and randomness are arguments. Common random numbers: every stage has its own stream
/// and draws a fixed number of times per packet offered. So the fate of the n-th packet depends on
/// seed, link, n and time, not on the other stages, nor on who sends or listens.
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
    // Packets that were not lost:
    std::int64_t corrupted = 0;
    std::int64_t reordered = 0;
  };
  using Observer = std::function<void(const PacketFate&)>;

  /// `process` may be shared between links.
  Link(LinkStages stages, std::shared_ptr<ChannelProcess> process);

  /// From the next packet on, other stages and conditions: renewed_stages() and renew_models() make
  /// them from the present ones, since the latest push().
  ///
  /// Packets under way stay so and leave when they would have left; counters, delays and the
  /// numbers of packets go on. The luck of the n-th packet in each stage stays a function of seed,
  /// link and n, and the state of a process in time one of seed, t and the settings at t: runs that
  /// differ in their changes meet the same network where they have the same settings. Only what
  /// remembers packets (renewed_stages(), processes per packet) depends on earlier settings.
  void apply(LinkStages stages, std::shared_ptr<ChannelProcess> process);

  /// Returns when the packet leaves; Instant::max() if it never does.
  Instant push(Instant now, Packet packet);

  /// When the copy of the packet that was pushed last leaves; Instant::max() if there is none.
  Instant copy_departure() const { return copy_departure_; }

  /// When the next packet leaves; Instant::max() if none is under way.
  Instant next_event() const { return queue_.next_departure(); }

  /// Hands over every packet due by `now`, in order of departure, then of arrival.
  void pop_ready(Instant now, const std::function<void(const Packet&)>& deliver);

  /// Receives each packet's fate from now on, at the end of push().
  void set_observer(Observer observer) { observer_ = std::move(observer); }

  const Counters& counters() const { return counters_; }
  std::int64_t in_flight() const { return static_cast<std::int64_t>(queue_.size()); }
  const PacketQueue& under_way() const { return queue_; }
  /// Sojourn times of the delivered packets, copies included.
  const DelayHistogram& delays() const { return delays_; }
  const LinkStages& stages() const { return stages_; }
  ChannelProcess& process() { return *process_; }
  const ChannelProcess& process() const { return *process_; }

 private:
  Instant send(const OfferedPacket& offered, Packet&& packet, bool is_copy);
  void send_both(OfferedPacket& offered);

  LinkStages stages_;
  std::shared_ptr<ChannelProcess> process_;
  Instant copy_departure_ = Instant::max();
  PacketQueue queue_;
  Counters counters_;
  DelayHistogram delays_;
  Observer observer_;
};

}  // namespace tether
