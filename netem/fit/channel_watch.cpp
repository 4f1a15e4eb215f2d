#include "netem/fit/channel_watch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <limits>
#include <utility>

#include "netem/channel/settings.hpp"

namespace tether {

std::vector<PacketFate> sample_fates(Link& link, const LinkTraffic& traffic, std::int64_t count) {
  std::vector<PacketFate> fates;
  fates.reserve(static_cast<std::size_t>(count));
  link.set_observer([&fates](const PacketFate& fate) { fates.push_back(fate); });
  const Duration period = std::max(Duration{1}, from_seconds(traffic.interval_s));
  const auto bytes = static_cast<std::size_t>(traffic.packet_bytes);
  for (std::int64_t i = 0; i < count; ++i) {
    const Instant now = kStart + i * period;
    link.push(now, {"", std::vector<std::uint8_t>(bytes)});
    link.pop_ready(now, [](const Packet&) {});
  }
  link.set_observer({});
  return fates;
}

using Outcome = PacketFate::Outcome;

LinkMonitor::LinkMonitor(LinkExpectation expected) : expected_(std::move(expected)) {
  const std::size_t states = expected_.channel ? expected_.channel->states().size() : 0;
  if (states > 1) sojourns_.emplace(states);
}

void LinkMonitor::on_packet(const PacketFate& fate) {
  if (fate.arrival < kStart) return;
  if (sojourns_ && !expected_.moves_in_time) {
    sojourns_->enter(static_cast<std::size_t>(fate.state), static_cast<double>(packets_));
  }
  ++packets_;
  if (fate.outcome == Outcome::outage) {
    ++in_outages_;
    return;
  }
  loss_.add(fate.outcome == Outcome::lost, fate.arrival);
  if (fate.outcome == Outcome::under_way) delays_.add(fate.departure - fate.arrival);
  overflowed_ += fate.outcome == Outcome::overflowed ? 1 : 0;
}

void LinkMonitor::on_state(int state, Instant now) {
  if (wants_states()) sojourns_->enter(static_cast<std::size_t>(state), to_seconds(now));
}

std::vector<ChannelCheck> LinkMonitor::checks(Instant end,
                                              const ChannelCheckOptions& options) const {
  std::vector<ChannelCheck> checks;
  if (expected_.channel) {
    std::optional<SojournStatistics> sojourns = sojourns_;
    if (sojourns) {
      sojourns->advance(expected_.moves_in_time ? to_seconds(end) : static_cast<double>(packets_));
    }
    checks = compare_channel(*expected_.channel, loss_, delays_, sojourns ? &*sojourns : nullptr,
                             options);
  } else {
    checks = open_checks(options.shown_confidence);
  }
  leave_open(checks, options.shown_confidence);
  return checks;
}

std::vector<ChannelCheck> LinkMonitor::open_checks(double confidence) const {
  constexpr double kOpen = std::numeric_limits<double>::quiet_NaN();
  const LossSpread spread = loss_.estimated_spread();
  std::vector<ChannelCheck> checks{
      {"PRR", "", kOpen, loss_.prr(confidence, spread), Verdict::not_comparable, ""},
      {"mean loss burst", "packets", kOpen, loss_.mean_burst(confidence, spread),
       Verdict::not_comparable, ""},
      {"lag-1 correlation", "", kOpen, loss_.lag1_correlation(confidence, spread),
       Verdict::not_comparable, ""}};
  for (std::size_t i = 0; i < DelayStatistics::kQuantiles.size(); ++i) {
    const double q = DelayStatistics::kQuantiles[i];
    Estimate achieved = delays_.quantile(q, confidence, delays_.estimated_vif(i));
    for (double* x : {&achieved.value, &achieved.low, &achieved.high}) *x *= 1e3;
    checks.push_back({fmt::format("delay p{:.0f}", 100.0 * q), "ms", kOpen, achieved,
                      Verdict::not_comparable, ""});
  }
  return checks;
}

void LinkMonitor::leave_open(std::vector<ChannelCheck>& checks, double confidence) const {
  // Where the model predicts no value, it predicts no spread either.
  const std::vector<ChannelCheck> measured = open_checks(confidence);
  const auto open = [&measured](ChannelCheck& check, const std::string& reason) {
    if (reason.empty()) return;
    for (const ChannelCheck& m : measured) {
      if (m.quantity == check.quantity) check = m;
    }
    check.reason = reason;
  };
  for (ChannelCheck& check : checks) {
    const bool of_delay = check.quantity.starts_with("delay");
    const bool of_sojourn = check.quantity.starts_with("mean sojourn");
    if (of_sojourn) continue;
    if (of_delay) {
      if (overflowed_ > 0) open(check, fmt::format("{} packets found no room", overflowed_));
      open(check, expected_.no_delays);
      continue;
    }
    if (check.quantity != "PRR" && in_outages_ > 0) open(check, "outages cut bursts");
    if (check.quantity == "PRR" && overflowed_ + in_outages_ > 0) {
      check.reason = fmt::format("without {} packets in outages and {} for want of room",
                                 in_outages_, overflowed_);
    }
    open(check, expected_.no_losses);
  }
}

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
