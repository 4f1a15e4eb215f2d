#include "netem/medium/scheduled_cell.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

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

std::size_t ScheduledCell::add(const std::string& name) {
  RandomEngine random = random_stream(seed_, name);
  const auto phase = Duration{static_cast<std::int64_t>(
      uniform_01(random) * static_cast<double>(rules_.request_period.count()))};
  users_.push_back({phase, {}, random});
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
  if (u.packets.size() >= rules_.queue) {
    ++counters_.overflowed;
    return false;
  }
  // What waits for a grant already, or is being sent, asks for this one, too.
  const Instant granted = u.packets.empty() ? next_request(u, now) + rules_.offset
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

/// Of those that may send at `now`.
std::size_t ScheduledCell::choose(Instant now) const {
  std::size_t best = users_.size();
  double most = 0.0;
  for (std::size_t k = 1; k <= users_.size(); ++k) {
    const std::size_t i = (last_ + k) % users_.size();
    const User& u = users_[i];
    if (u.packets.empty() || u.packets.front().granted > now) continue;
    if (!urgency_) return i;
    const double urgency = urgency_(i, u.packets.front().since, now);
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
  ended_({packet.id, !failed, free_from_, packet.attempts});
  u.packets.pop_front();
}

}  // namespace tether
