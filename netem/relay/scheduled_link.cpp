#include "netem/relay/scheduled_link.hpp"

#include <utility>

namespace tether {

ScheduledLink::ScheduledLink(Link link, EventLoop& loop, Deliver deliver)
    : link_(std::move(link)), loop_(loop), deliver_(std::move(deliver)) {}

void ScheduledLink::take(Packet packet) {
  const Instant departure = link_.push(loop_.now(), std::move(packet));
  const Instant copy_departure = link_.copy_departure();
  deliver_at(departure);
  deliver_at(copy_departure);
}

void ScheduledLink::deliver_at(Instant departure) {
  if (departure <= loop_.now()) {
    deliver_ready();
  } else if (departure != Instant::max()) {
    loop_.at(departure, Priority::delivery, [this](Instant) { deliver_ready(); });
  }
}

void ScheduledLink::deliver_ready() { link_.pop_ready(loop_.now(), deliver_); }

}  // namespace tether
