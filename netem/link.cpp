#include "netem/link.hpp"

#include <algorithm>
#include <boost/random/uniform_01.hpp>
#include <utility>

namespace tether {

using Outcome = PacketFate::Outcome;

Link::Link(const LinkConfig& config, std::shared_ptr<ChannelProcess> process,
           const LinkStreams& streams, const std::vector<double>& delay_table_ms)
    : config_(config),
      process_(std::move(process)),
      outages_(config.outages),
      state_loss_(streams("loss")),
      loss_(config.loss, streams("random_loss")) {
  if (config.corrupt.probability > 0.0) corruption_.emplace(config.corrupt, streams("corrupt"));
  if (config.rate.bits_per_s > 0.0) rate_.emplace(config.rate);
  if (config.reorder.probability > 0.0) reordering_.emplace(config.reorder, streams("reorder"));
  if (config.slot.period_ms > 0.0) slots_.emplace(config.slot, streams("slot"));
  const bool copies = config.duplicate_probability > 0.0;
  if (copies) duplication_.emplace(config.duplicate_probability, streams("duplicate"));
  if (config.jitter.law == JitterConfig::Law::none) return;
  const DelayLaw law(config.jitter, delay_table_ms);
  const double correlation = config.jitter.correlation;
  jitter_.emplace(law, correlation, streams("delay"));
  if (copies) copy_jitter_.emplace(law, correlation, streams("copy_delay"));
}

Link::Luck Link::draw(const LinkCondition& condition) {
  Luck luck;
  luck.lost = boost::random::uniform_01<double>()(state_loss_) >= condition.prr;
  if (loss_.toss()) luck.lost = true;
  if (corruption_) luck.damage = corruption_->next();
  if (duplication_) luck.duplicate = duplication_->toss();
  if (jitter_) luck.jitter = jitter_->next();
  if (copy_jitter_) luck.copy_jitter = copy_jitter_->next();
  if (reordering_) luck.skips_delay = reordering_->skips_delay();
  return luck;
}

PacketFate::Outcome Link::entry(Instant now, const Luck& luck) const {
  if (outages_.out(now)) return Outcome::outage;
  return luck.lost ? Outcome::lost : Outcome::under_way;
}

Instant Link::push(Instant now, Packet packet) {
  const LinkCondition condition = process_->on_packet(now);
  const Luck luck = draw(condition);
  copy_departure_ = Instant::max();
  PacketFate fate;
  fate.number = counters_.offered++;
  fate.arrival = now;
  fate.state = process_->state();
  fate.outcome = entry(now, luck);
  if (fate.outcome == Outcome::under_way) {
    fate.corrupted = corruption_ && corruption_->apply(luck.damage, packet.bytes);
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
  const bool room = in_flight() < config_.queue_limit && bytes <= config_.queue_limit_bytes;
  const std::optional<Instant> through = !room   ? std::nullopt
                                         : rate_ ? rate_->pass(now, packet.bytes.size())
                                                 : std::optional(now);
  if (!through) {
    ++counters_.overflowed;
    return std::nullopt;
  }
  Instant departure = *through + delay;
  if (config_.in_order) departure = latest_departure_ = std::max(departure, latest_departure_);
  if (slots_) departure = slots_->place(now, departure);
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
