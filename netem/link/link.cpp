#include "netem/link/link.hpp"

#include <algorithm>
#include <utility>

namespace tether {

using Outcome = PacketFate::Outcome;

Link::Link(const LinkConfig& config, std::shared_ptr<ChannelProcess> process,
           const LinkStreams& streams, const std::vector<double>& delay_table_ms)
    : stages_(config, streams, delay_table_ms), process_(std::move(process)) {}

Link::Change Link::prepare(const LinkConfig& config, std::shared_ptr<ChannelProcess> process,
                           const LinkStreams& streams,
                           const std::vector<double>& delay_table_ms) const {
  return {stages_.renewed(config, streams, delay_table_ms, counters_.offered), std::move(process)};
}

void Link::apply(Change change) {
  if (change.stages.config.in_order) {
    latest_departure_ = std::max(latest_departure_, queue_.last_departure());
  }
  stages_ = std::move(change.stages);
  process_ = std::move(change.process);
}

PacketFate::Outcome Link::entry(Instant now, const Luck& luck) const {
  if (stages_.outages.out(now)) return Outcome::outage;
  return luck.lost ? Outcome::lost : Outcome::under_way;
}

Instant Link::push(Instant now, Packet packet) {
  const LinkCondition condition = process_->on_packet(now);
  const Luck luck = stages_.draw(condition.prr);
  copy_departure_ = Instant::max();
  PacketFate fate;
  fate.number = counters_.offered++;
  fate.arrival = now;
  fate.state = process_->state();
  fate.outcome = entry(now, luck);
  if (fate.outcome == Outcome::under_way) {
    fate.corrupted = stages_.corruption && stages_.corruption->apply(luck.damage, packet.bytes);
    fate.reordered = luck.skips_delay;
    counters_.corrupted += fate.corrupted ? 1 : 0;
    counters_.reordered += fate.reordered ? 1 : 0;
    counters_.duplicated += luck.duplicate ? 1 : 0;
    const auto delay = [&](Duration jitter) {
      return luck.skips_delay ? Duration{0} : std::max(Duration{0}, condition.delay + jitter);
    };
    std::optional<Packet> copy;
    if (luck.duplicate) copy = packet;
    const auto departure = send(now, delay(luck.jitter), std::move(packet));
    fate.departure = departure.value_or(Instant::max());
    if (!departure) fate.outcome = Outcome::overflowed;
    if (copy) {
      const auto later = send(now, delay(luck.copy_jitter), *std::move(copy));
      fate.duplicated = later.has_value();
      copy_departure_ = later.value_or(Instant::max());
    }
  }
  counters_.outage_dropped += fate.outcome == Outcome::outage ? 1 : 0;
  counters_.lost += fate.outcome == Outcome::lost ? 1 : 0;
  if (observer_) observer_(fate);
  return fate.departure;
}

std::optional<Instant> Link::send(Instant now, Duration delay, Packet&& packet) {
  const auto bytes = static_cast<std::int64_t>(queue_.bytes() + packet.bytes.size());
  const bool room =
      in_flight() < stages_.config.queue_limit && bytes <= stages_.config.queue_limit_bytes;
  const std::optional<Instant> through = !room ? std::nullopt
                                         : stages_.rate
                                             ? stages_.rate->pass(now, packet.bytes.size())
                                             : std::optional(now);
  if (!through) {
    ++counters_.overflowed;
    return std::nullopt;
  }
  Instant departure = *through + delay;
  if (stages_.config.in_order)
    departure = latest_departure_ = std::max(departure, latest_departure_);
  if (stages_.slots) departure = stages_.slots->place(now, departure);
  queue_.push(now, departure, std::move(packet));
  return departure;
}

void Link::pop_ready(Instant now, const std::function<void(const Packet&)>& deliver) {
  PacketQueue::Ready ready;
  while (queue_.pop(now, ready)) {
    ++counters_.delivered;
    counters_.delivered_bytes += static_cast<std::int64_t>(ready.packet.bytes.size());
    delays_.add(now - ready.arrival);
    deliver(ready.packet);
  }
}

}  // namespace tether
