#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "common/base/counters.hpp"
#include "common/loop/event_loop.hpp"
#include "netem/link/packet_queue.hpp"
#include "netem/medium/shared_medium.hpp"

namespace tether {

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

  /// Whether the medium needs the vehicle's position, which it receives before the network.
  bool wants_position() const { return medium_ && medium_->wants_position(); }
  void on_position(std::size_t vehicle, double x_m, double y_m);

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

}  // namespace tether
