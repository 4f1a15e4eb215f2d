#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <tether/link_report_t.hpp>
#include <utility>

#include "common/base/counters.hpp"
#include "common/node/event_loop.hpp"
#include "netem/channel/settings.hpp"
#include "netem/link/link.hpp"
#include "netem/link/packet_queue.hpp"
#include "netem/medium/shared_medium.hpp"

namespace tether {

/// A link on a loop: takes packets when they come, and hands them over when they are due. Stays
/// where it is: tasks on the loop refer to it.
class ScheduledLink {
 public:
  using Deliver = std::function<void(const Packet&)>;

  ScheduledLink(Link link, EventLoop& loop, Deliver deliver);
  ScheduledLink(const ScheduledLink&) = delete;
  ScheduledLink& operator=(const ScheduledLink&) = delete;

  /// Offers a packet to the link now.
  void take(Packet packet);

  Link& link() { return link_; }
  const Link& link() const { return link_; }

 private:
  void deliver_at(Instant departure);
  void deliver_ready();

  Link link_;
  EventLoop& loop_;
  Deliver deliver_;
};

/// Carries other packets the way that a link's own go: the same conditions of the channel at the
/// same time, the same stages with the same settings. But their luck is their own (streams
/// "<vehicle>/<name>/<purpose>"), and so are their room and their bottleneck: what is offered here
/// changes nothing for the link's own packets. A channel per packet (gilbert_elliott, four_state)
/// takes no step for these: they meet the state in which the link's last packet left it.
class CompanionLink {
 public:
  using Deliver = ScheduledLink::Deliver;

  /// `of`: the link's name in the scenario; `link`, which is that, and `loop` must outlive this.
  CompanionLink(const NetemSettings& settings, std::string name, std::string of, Link& link,
                EventLoop& loop, Deliver deliver);
  CompanionLink(const CompanionLink&) = delete;
  CompanionLink& operator=(const CompanionLink&) = delete;

  void take(Packet packet) { scheduled_.take(std::move(packet)); }

  /// The link has other settings.
  void renew(const NetemSettings& after);

  const Link::Counters& counters() const { return scheduled_.link().counters(); }
  /// "<name>.offered", .lost, .overflowed and .delivered, if anything was offered.
  void list_counters(CounterList& out) const;

 private:
  std::string name_;
  std::string of_;
  NetemSettings settings_;
  std::shared_ptr<ChannelProcess> process_;
  ScheduledLink scheduled_;
};

/// The shared medium on a loop: carries vehicles' packets over the air, and hands on those that
/// arrive when they do. With medium.serve = "most_valuable" it tells the medium how far a new
/// message is from those delivered before (divergence.hpp), like a sender that is notified of each
/// arrival. With medium.model = none it hands on all at once. Stays where it is: tasks on the loop
/// refer to it.
class RunningMedium {
 public:
  using Deliver = std::function<void(Packet)>;

  RunningMedium(const MediumSettings& settings, std::uint64_t seed, EventLoop& loop);
  RunningMedium(const RunningMedium&) = delete;
  RunningMedium& operator=(const RunningMedium&) = delete;

  /// Returns the vehicle's number. Before any packet is sent.
  std::size_t add_vehicle(const std::string& name);
  /// `deliver` must outlive the packet's way.
  void send(std::size_t vehicle, Way way, Packet packet, const Deliver& deliver);
  /// The same for a packet that is not a message of LCM: `bytes` of UDP payload.
  void send(std::size_t vehicle, Way way, Packet packet, int bytes, const Deliver& deliver);

  /// Whether the medium needs the vehicle's position, which it receives before the network.
  bool wants_position() const { return medium_ && medium_->wants_position(); }
  void on_position(std::size_t vehicle, double x_m, double y_m);

  /// Appends the counters as they are now.
  void list_counters(CounterList& out) const;

 private:
  struct UnderWay {
    Packet packet;
    const Deliver* deliver;
    double value = 0.0;  ///< with serve = "most_valuable"
  };
  double value_of(const Packet& packet) const;
  void know(const Packet& delivered);
  void wake();
  void ended(const PacketFateOnAir& fate);

  EventLoop& loop_;
  std::unique_ptr<SharedMedium> medium_;
  std::map<std::string, Packet> known_;  ///< by its channel what its receiver got last
  bool has_values_;
  std::uint64_t next_id_ = 0;
  std::map<std::uint64_t, UnderWay> under_way_;
  Instant wakes_at_ = Instant::max();
};

/// A link on a loop that reports every period and at each change of its channel's state. Stays
/// where it is: tasks on the loop refer to it.
class RunningLink {
 public:
  using Deliver = ScheduledLink::Deliver;
  using Report = std::function<void(const link_report_t&)>;

  RunningLink(std::string name, Link link, EventLoop& loop, Duration report_period, Deliver deliver,
              Report report);
  RunningLink(const RunningLink&) = delete;
  RunningLink& operator=(const RunningLink&) = delete;

  /// Offers a packet to the link now.
  void take(Packet packet) { scheduled_.take(std::move(packet)); }

  /// The link has got other settings: restarts watching its channel's state, and reports now.
  void changed();

  /// Makes and hands over a report now.
  void report();

  const std::string& name() const { return name_; }
  Link& link() { return scheduled_.link(); }
  const Link& link() const { return scheduled_.link(); }

  /// "<name>.offered" and so on; rare ones only if they happened.
  void list_counters(CounterList& out) const;

 private:
  void watch_state();

  std::string name_;
  ScheduledLink scheduled_;
  EventLoop& loop_;
  Report report_;
  std::int64_t report_seq_ = 0;
  std::int64_t watch_ = 0;  // the one that counts; tasks of earlier ones do nothing
};

}  // namespace tether
