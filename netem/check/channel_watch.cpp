#include "netem/check/channel_watch.hpp"

#include <algorithm>
#include <utility>

#include "netem/channel/settings.hpp"

namespace tether {
namespace {

LinkMonitor monitor_of(const LinkConfig& link, const LinkTraffic& traffic) {
  return LinkMonitor(expect_link(link, traffic));
}

/// In a run, whose settings may change on the way.
LinkMonitor monitor_in_run(const ChannelSettings& channel, const LinkConfig& link,
                           const LinkTraffic& traffic) {
  if (channel.changes.empty()) return monitor_of(link, traffic);
  LinkExpectation open;
  open.no_losses = open.no_delays = "the settings change during the run";
  return LinkMonitor(open);
}

/// One direction of a trial.
struct Stream {
  Stream(Link& its_link, const LinkConfig& config, const LinkTraffic& traffic)
      : link(its_link),
        monitor(monitor_of(config, traffic)),
        period(std::max(Duration{1}, from_seconds(traffic.interval_s))),
        bytes(static_cast<std::size_t>(traffic.packet_bytes)) {
    link.set_observer([this](const PacketFate& fate) { monitor.on_packet(fate); });
    link.process().advance(kStart);
    monitor.on_state(link.process().state(), kStart);
  }
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;

  Instant next() const { return kStart + offered * period; }

  void offer() {
    const Instant now = next();
    link.push(now, {"", std::vector<std::uint8_t>(bytes)});
    link.pop_ready(now, [](const Packet&) {});
    ++offered;
  }

  Link& link;
  LinkMonitor monitor;
  Duration period;
  std::size_t bytes;
  std::int64_t offered = 0;
};

/// Moves the states of both streams, which may be one process, up to `now`.
void follow_states(Stream& a, Stream& b, Instant now) {
  for (;;) {
    Instant next = Instant::max();
    for (const Stream* s : {&a, &b}) {
      if (s->monitor.wants_states()) next = std::min(next, s->link.process().next_transition());
    }
    if (next > now) return;
    for (Stream* s : {&a, &b}) {
      if (!s->monitor.wants_states()) continue;
      s->link.process().advance(next);
      s->monitor.on_state(s->link.process().state(), next);
    }
  }
}

}  // namespace

ChannelWatch::ChannelWatch(const ChannelSettings& channel, const ChannelTraffic& traffic,
                           EventLoop& loop, Link& uplink, Link& downlink)
    : loop_(loop),
      uplink_(monitor_in_run(channel, channel.uplink, traffic.uplink)),
      downlink_(monitor_in_run(channel, channel.downlink, traffic.downlink)) {
  for (const auto& [link, monitor] : {std::pair{&uplink, &uplink_}, {&downlink, &downlink_}}) {
    link->set_observer([monitor = monitor](const PacketFate& fate) { monitor->on_packet(fate); });
    if (!monitor->wants_states()) continue;
    link->process().advance(loop.now());
    monitor->on_state(link->process().state(), std::max(kStart, loop.now()));
    watch_state(*link, *monitor);
  }
}

void ChannelWatch::watch_state(Link& link, LinkMonitor& monitor) {
  const Instant next = link.process().next_transition();
  if (next == Instant::max()) return;
  loop_.at(next, Priority::observer, [this, &link, &monitor](Instant scheduled) {
    link.process().advance(scheduled);
    monitor.on_state(link.process().state(), scheduled);
    watch_state(link, monitor);
  });
}

ChannelReport ChannelWatch::report(Instant end) const {
  return {{uplink_.packets(), uplink_.checks(end)}, {downlink_.packets(), downlink_.checks(end)}};
}

ChannelReport try_channel(const NetemSettings& settings, const ChannelTraffic& traffic,
                          const ChannelTrial& trial) {
  LinkPair links = make_links(settings);
  const auto& channel = settings.get<ChannelSettings>();
  Stream up(links.uplink, channel.uplink, traffic.uplink);
  Stream down(links.downlink, channel.downlink, traffic.downlink);
  constexpr std::int64_t kBetweenReports = 1000;
  Instant now = kStart;
  while (std::min(up.offered, down.offered) < trial.packets) {
    const bool up_next =
        down.offered == trial.packets || (up.offered < trial.packets && up.next() <= down.next());
    Stream& stream = up_next ? up : down;
    now = stream.next();
    follow_states(up, down, now);
    stream.offer();
    const std::int64_t offered = up.offered + down.offered;
    if (trial.on_progress && offered % kBetweenReports == 0) trial.on_progress(offered);
  }
  return {{up.offered, up.monitor.checks(now)}, {down.offered, down.monitor.checks(now)}};
}

}  // namespace tether
