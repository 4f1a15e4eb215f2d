#include "netem/link/link.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tether {

void DelayHistogram::add(Duration delay) {
  delay = std::max(delay, Duration{0});
  Bin& bin = bins_.of(delay.count());
  ++bin.count;
  bin.sum_ns += delay.count();
  ++count_;
  sum_ns_ += static_cast<double>(delay.count());
  max_ = std::max(max_, delay);
}

Duration DelayHistogram::quantile(double q) const {
  if (count_ == 0) return Duration{0};
  const auto rank = static_cast<std::int64_t>(std::ceil(q * static_cast<double>(count_)));
  const Bin& bin = bins_.of_rank(std::max<std::int64_t>(1, rank));
  return Duration{bin.sum_ns / bin.count};
}

Duration DelayHistogram::mean() const {
  return count_ == 0 ? Duration{0} : Duration{std::llround(sum_ns_ / static_cast<double>(count_))};
}

using Outcome = PacketFate::Outcome;

Link::Link(LinkStages stages, std::shared_ptr<ChannelProcess> process)
    : stages_(std::move(stages)), process_(std::move(process)) {}

void Link::apply(LinkStages stages, std::shared_ptr<ChannelProcess> process) {
  stages_ = std::move(stages);
  process_ = std::move(process);
}

Instant Link::push(Instant now, Packet packet) {
  copy_departure_ = Instant::max();
  OfferedPacket offered{packet, process_->on_packet(now), {}};
  offered.fate.number = counters_.offered++;
  offered.fate.arrival = now;
  offered.fate.state = process_->state();
  for (const StagePtr& stage : stages_) stage->meet(offered);
  if (offered.goes_on()) send_both(offered);
  counters_.outage_dropped += offered.fate.outcome == Outcome::outage ? 1 : 0;
  counters_.lost += offered.fate.outcome == Outcome::lost ? 1 : 0;
  if (observer_) observer_(offered.fate);
  return offered.fate.departure;
}

void Link::send_both(OfferedPacket& offered) {
  PacketFate& fate = offered.fate;
  counters_.corrupted += fate.corrupted ? 1 : 0;
  counters_.reordered += fate.reordered ? 1 : 0;
  counters_.duplicated += offered.copied ? 1 : 0;
  std::optional<Packet> copy;
  if (offered.copied) copy = offered.packet;
  fate.departure = send(offered, std::move(offered.packet), false);
  if (fate.departure == Instant::max()) fate.outcome = Outcome::overflowed;
  if (!copy) return;
  copy_departure_ = send(offered, *std::move(copy), true);
  fate.duplicated = copy_departure_ != Instant::max();
}

/// Instant::max() if there is no room.
Instant Link::send(const OfferedPacket& offered, Packet&& packet, bool is_copy) {
  const Instant now = offered.fate.arrival;
  Passage passage{.now = now,
                  .bytes = packet.bytes.size(),
                  .under_way = queue_,
                  .sent = now,
                  .delay = offered.condition.delay,
                  .skips_delay = offered.fate.reordered,
                  .is_copy = is_copy};
  for (const StagePtr& stage : stages_) {
    if (stage->pass(passage)) continue;
    ++counters_.overflowed;
    return Instant::max();
  }
  const Instant departure = passage.departure();
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
