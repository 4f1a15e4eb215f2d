#pragma once

#include "common/base/time.hpp"

namespace tether {

/// Treatment of the packets of a link under one condition of the channel.
struct LinkCondition {
  double prr = 1.0;  ///< probability that the packet gets through, 0..1
  Duration delay{
      0};  ///< delay of received packets, before the link's delay law adds to it; never negative

  bool operator==(const LinkCondition&) const = default;
};

/// Process that decides the conditions of a link: a constant, a Markov chain, a trace, a map.
///
/// Two kinds share this interface:
/// - Processes in *time* (fixed, markov, chain, trace, map) implement advance(): what they say at
///   time t is a function of the seed and of t (and of where the vehicle is), not of the traffic,
///   nor of how often or by how many links they are asked. Links may share one.
/// - Processes per *packet* (gilbert_elliott, four_state) override on_packet() and take one step
///   for each packet that is offered: what the n-th packet of the link meets is a function of the
///   seed and of n. They belong to one link.
///
/// Randomness comes from an engine that only this process uses, so that adding draws here changes
/// nothing elsewhere. Whether a packet is lost is not decided here: the link draws one uniform
/// number a packet from its own stream and compares it with `prr`. A process that decides fates
/// itself, such as a recorded loss, says prr 0 or 1.
///
/// Pure: no clock, no I/O after construction. Time never goes back; an earlier `now` than the
/// last one changes nothing.
class ChannelProcess {
 public:
  ChannelProcess() = default;
  ChannelProcess(const ChannelProcess&) = delete;
  ChannelProcess& operator=(const ChannelProcess&) = delete;
  virtual ~ChannelProcess() = default;

  /// Moves on to `now`. Processes per packet do nothing.
  virtual void advance(Instant now) = 0;

  /// Condition for the packet that is offered at `now`. Called exactly once for each packet of a
  /// link, in order, whatever becomes of the packet (also when an outage has already taken it).
  virtual LinkCondition on_packet(Instant now) {
    advance(now);
    return condition();
  }

  /// The conditions after the latest call of advance(), on_packet() or on_position(). For processes
  /// per packet: of the state that they are in now.
  virtual LinkCondition condition() const = 0;

  /// For reports and plots: which state the channel is in, from 0 (markov: 0 good, 1 bad).
  /// Processes without states, such as a map, stay at 0; a trace counts its rows.
  virtual int state() const { return 0; }

  /// When state() changes next, later than the latest advance(): the relay advances the process
  /// then and reports. Instant::max() if never, or if that is not a question of time. Processes
  /// whose conditions change all the time (a map, an interpolated trace) say Instant::max() too.
  virtual Instant next_transition() const { return Instant::max(); }

  /// Where the vehicle was at `now`, in the world's frame. The relay reads it from the vehicle's
  /// pose channel, before the network, if wants_position() says so.
  virtual void on_position(double /*x_m*/, double /*y_m*/, Instant /*now*/) {}
  virtual bool wants_position() const { return false; }
};

}  // namespace tether
