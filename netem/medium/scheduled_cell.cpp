#include "netem/medium/scheduled_cell.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <iterator>
#include <limits>

namespace tether {
namespace {

Instant next_on_grid(Instant t, Duration phase, Duration period) {
  const Duration since = t - kStart - phase;
  const Duration rest = ((since % period) + period) % period;
  return rest == Duration{0} ? t : t + (period - rest);
}

}  // namespace

ScheduledCell::ScheduledCell(const ScheduledRules& rules, std::uint64_t seed, Ended ended)
    : rules_(rules), seed_(seed), ended_(std::move(ended)) {
  assert(rules.slot > Duration{0} && rules.request_period > Duration{0} && rules.attempts > 0);
}

std::size_t ScheduledCell::add(const std::string& name, const CellUser& kind) {
  RandomEngine random = random_stream(seed_, name);
  const auto phase = Duration{static_cast<std::int64_t>(
      uniform_01(random) * static_cast<double>(rules_.request_period.count()))};
  users_.push_back({phase, kind, random});
  return users_.size() - 1;
}

Duration ScheduledCell::airtime(int bytes) const {
  const double slots = std::ceil(8e-6 * bytes / rules_.rate_Mbps / to_seconds(rules_.slot) - 1e-9);
  return std::max<std::int64_t>(1, static_cast<std::int64_t>(slots)) * rules_.slot;
}

Instant ScheduledCell::slot_at_or_after(Instant t) const {
  return next_on_grid(t, Duration{0}, rules_.slot);
}

Instant ScheduledCell::next_request(const User& user, Instant now) const {
  return next_on_grid(now, user.phase, rules_.request_period);
}

bool ScheduledCell::push(Instant now, std::size_t user, std::uint64_t id, int bytes) {
  for (Instant next = next_event(); next < now; next = next_event()) transmit(next);
  User& u = users_[user];
  const Message message{id / rules_.ids_of_a_message, now};
  const std::optional<Instant> asked = u.kind.keeps_newest ? replace(u, message) : std::nullopt;
  if (u.packets.size() >= rules_.queue) {
    ++counters_.overflowed;
    lose_part_of(u, message);
    return false;
  }
  // Packets that wait for a grant already, or are being sent, request this one, too.
  const Instant granted = asked               ? std::max(now, *asked)
                          : u.packets.empty() ? next_request(u, now) + rules_.offset
                                              : std::max(now, u.packets.back().granted);
  u.packets.push_back({id, bytes, now, granted});
  return true;
}

Instant ScheduledCell::next_event() const {
  Instant first = Instant::max();
  for (const User& u : users_) {
    if (!u.packets.empty()) first = std::min(first, u.packets.front().granted);
  }
  return first == Instant::max() ? first : slot_at_or_after(std::max(first, free_from_));
}

void ScheduledCell::advance(Instant now) {
  for (Instant next = next_event(); next <= now; next = next_event()) transmit(next);
}

/// When the messages that `by` replaces were granted, if there are any.
std::optional<Instant> ScheduledCell::replace(User& user, const Message& by) {
  if (user.packets.empty()) return std::nullopt;
  std::optional<Instant> granted;
  std::vector<std::uint64_t> replaced;
  std::erase_if(user.packets, [&](const Packet& packet) {
    const Message message = message_of(packet);
    if (message == by || message == user.begun) return false;
    granted = std::max(granted.value_or(packet.granted), packet.granted);
    replaced.push_back(packet.id);
    return true;
  });
  counters_.replaced += std::ssize(replaced);
  for (const std::uint64_t id : replaced) ended_({id, false, by.second, 0});
  return granted;
}

/// Drops the rest of a message, which is useless without the lost part.
void ScheduledCell::lose_part_of(User& user, const Message& message) const {
  for (Packet& packet : user.packets) packet.is_news &= message_of(packet) != message;
}

/// The largest goes first.
double ScheduledCell::urgency_of(std::size_t user, Instant now) const {
  const User& u = users_[user];
  if (urgency_) return urgency_(user, u.packets.front().since, now);
  if (rules_.serve == ScheduledRules::Serve::most_valuable) {
    return value_ ? value_(u.packets.back().id) : 0.0;
  }
  return u.newest_delivered ? to_seconds(now - *u.newest_delivered)
                            : std::numeric_limits<double>::infinity();
}

/// Chooses a user of those that may send at `now`.
std::size_t ScheduledCell::choose(Instant now) const {
  std::size_t best = users_.size();
  double most = 0.0;
  for (std::size_t k = 1; k <= users_.size(); ++k) {
    const std::size_t i = (last_ + k) % users_.size();
    const User& u = users_[i];
    if (u.packets.empty() || u.packets.front().granted > now) continue;
    if (!urgency_ && rules_.serve == ScheduledRules::Serve::round_robin) return i;
    const double urgency = urgency_of(i, now);
    if (best == users_.size() || urgency > most) best = i, most = urgency;
  }
  return best;
}

void ScheduledCell::transmit(Instant start) {
  const std::size_t i = choose(start);
  assert(i < users_.size());
  User& u = users_[i];
  Packet& packet = u.packets.front();
  last_ = i;
  u.begun = message_of(packet);
  const Duration takes = airtime(packet.bytes);
  free_from_ = start + takes;
  counters_.busy += takes;
  ++counters_.transmissions;
  ++packet.attempts;
  const bool failed = rules_.error_ratio > 0.0 && uniform_01(u.random) < rules_.error_ratio;
  if (failed && packet.attempts < rules_.attempts) {
    packet.granted = free_from_ + rules_.repeat_after;
    return;
  }
  ++(failed ? counters_.lost : counters_.delivered);
  const PacketEnd end{packet.id, !failed, free_from_, packet.attempts};
  const Message message = message_of(packet);
  const bool is_news = packet.is_news;
  u.packets.pop_front();
  const bool is_last = u.packets.empty() || message_of(u.packets.front()) != message;
  if (failed) lose_part_of(u, message);
  if (!failed && is_last && is_news) {
    u.newest_delivered = u.kind.has_age ? message.second : end.at;
  }
  ended_(end);
}

}  // namespace tether
