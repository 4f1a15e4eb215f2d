#include "netem/relay/running_medium.hpp"

#include <algorithm>
#include <iterator>
#include <limits>
#include <utility>

#include "netem/medium/value/divergence.hpp"

namespace tether {

RunningMedium::RunningMedium(const MediumSettings& settings, std::uint64_t seed, EventLoop& loop)
    : loop_(loop),
      medium_(SharedMedium::make(
          settings, seed, [this](const PacketFateOnAir& fate) { ended(fate); },
          [this](std::uint64_t id) { return under_way_.at(id).value; })),
      has_values_(settings.serve == ScheduledRules::Serve::most_valuable) {}

std::size_t RunningMedium::add_vehicle(const std::string& name) {
  return medium_ ? medium_->add_vehicle(name) : 0;
}

void RunningMedium::send(std::size_t vehicle, Way way, Packet packet, const Deliver& deliver) {
  if (!medium_) return deliver(std::move(packet));
  const auto bytes = static_cast<int>(datagram_bytes(packet.channel, std::ssize(packet.bytes)));
  const std::uint64_t id = next_id_++;
  const double value = has_values_ ? value_of(packet) : 0.0;
  under_way_.emplace(id, UnderWay{std::move(packet), &deliver, value});
  medium_->send(loop_.now(), vehicle, way, id, bytes);
  wake();
}

void RunningMedium::on_position(std::size_t vehicle, double x_m, double y_m) {
  if (!wants_position()) return;
  medium_->on_position(vehicle, x_m, y_m, loop_.now());
  wake();
}

/// At the medium's next event, unless that is planned already.
void RunningMedium::wake() {
  const Instant next = medium_->next_event();
  if (next >= wakes_at_) return;
  wakes_at_ = next;
  loop_.at(std::max(next, loop_.now()), Priority::delivery, [this, next](Instant now) {
    if (next != wakes_at_) return;
    wakes_at_ = Instant::max();
    medium_->advance(now);
    wake();
  });
}

void RunningMedium::ended(const PacketFateOnAir& fate) {
  auto packet = under_way_.extract(fate.id);
  if (!fate.delivered) return;
  if (has_values_) know(packet.mapped().packet);
  const auto hand_on = [arrived = std::move(packet.mapped())](Instant) {
    (*arrived.deliver)(arrived.packet);
  };
  if (fate.at <= loop_.now()) return hand_on(loop_.now());
  loop_.at(fate.at, Priority::delivery, hand_on);
}

double RunningMedium::value_of(const Packet& packet) const {
  const auto known = known_.find(packet.channel);
  return known == known_.end() ? std::numeric_limits<double>::infinity()
                               : divergence_m(packet.bytes, known->second.bytes);
}

/// Updates the value of other packets under way to the same receiver.
void RunningMedium::know(const Packet& delivered) {
  known_[delivered.channel] = delivered;
  for (auto& [id, other] : under_way_) {
    if (other.packet.channel == delivered.channel) other.value = value_of(other.packet);
  }
}

void RunningMedium::list_counters(CounterList& out) const {
  if (medium_) medium_->list(out);
}

}  // namespace tether
