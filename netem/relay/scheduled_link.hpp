#pragma once

#include <functional>

#include "common/loop/event_loop.hpp"
#include "netem/link/link.hpp"

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

}  // namespace tether
