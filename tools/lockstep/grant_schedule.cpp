#include "tools/lockstep/grant_schedule.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/base/text.hpp"
#include "common/lcm/lcm_datagrams.hpp"
#include "common/lockstep/channels.hpp"

namespace tether {

void GrantSchedule::add_node(std::string name, const std::vector<std::string>& subscriptions,
                             const EventKey& next) {
  Node node;
  node.name = std::move(name);
  for (const std::string& expression : subscriptions) node.subscriptions.emplace_back(expression);
  node.next = next;
  nodes_.push_back(std::move(node));
}

EventKey GrantSchedule::first_event(std::size_t node) const {
  const Node& n = nodes_[node];
  if (n.waiting.empty()) return n.next;
  const Delivery& d = n.waiting.front();
  return std::min(n.next, {d.message.when, d.order, static_cast<std::int32_t>(node)});
}

Instant GrantSchedule::now() const {
  EventKey first;
  for (std::size_t i = 0; i < nodes_.size(); ++i) first = std::min(first, first_event(i));
  return first.when;
}

std::optional<GrantSchedule::Grant> GrantSchedule::next() {
  EventKey first, second{end_ + Duration{1}, 0, -1};
  std::size_t node = 0;
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    EventKey key = first_event(i);
    if (key < first) {
      std::swap(key, first);
      node = i;
    }
    second = std::min(second, key);
  }
  if (first.when > end_) return std::nullopt;
  Node& n = nodes_[node];
  n.granted_from = first;
  Grant grant{node, second, {}};
  const auto rank = static_cast<std::int32_t>(node);
  while (!n.waiting.empty() &&
         EventKey{n.waiting.front().message.when, n.waiting.front().order, rank} < second) {
    grant.deliveries.push_back(std::move(n.waiting.front()));
    n.waiting.pop_front();
  }
  return grant;
}

void GrantSchedule::check(const Node& node, const Grant& grant, const EventKey& next,
                          const std::vector<Publication>& published) {
  const auto t = [](Instant when) {
    return when == Instant::max() ? std::string("never")
                                  : fmt::format("t = {:.6f} s", to_seconds(when));
  };
  auto numbers = node.numbers;
  std::int64_t last_index = -1;
  Instant last = node.granted_from.when;
  for (const Publication& p : published) {
    if (p.when < last) {
      throw BadAnswer(fmt::format("published on {} at {}, in its past: it was at {}", p.channel,
                                  t(p.when), t(last)));
    }
    if (p.when > grant.until.when || p.when > end_) {
      throw BadAnswer(fmt::format("published on {} at {}, beyond its grant until {}", p.channel,
                                  t(p.when), t(std::min(grant.until.when, end_))));
    }
    const std::int64_t due = ++numbers[p.channel];
    if (p.channel.empty() || p.channel.size() > kMaxChannelBytes ||
        p.channel.starts_with(kTimePrefix)) {
      throw BadAnswer(fmt::format("published on \"{}\", which is no channel for it", p.channel));
    }
    check_owner(node, p.channel);
    if (p.number != due) {
      throw BadAnswer(
          fmt::format("named message {} on {} where number {} was due", p.number, p.channel, due));
    }
    if (std::cmp_less_equal(p.index, last_index) || p.index >= first_insertion(1)) {
      throw BadAnswer(fmt::format("published on {} out of order", p.channel));
    }
    last_index = static_cast<std::int64_t>(p.index);
    last = p.when;
  }
  if (next.when < last) {
    throw BadAnswer(
        fmt::format("asked for an event at {}, in its past: it was at {}", t(next.when), t(last)));
  }
}

void GrantSchedule::check_owner(const Node& node, const std::string& channel) {
  if (owners_.empty()) return;
  const auto owner = owners_.find(channel);
  if (owner != owners_.end()) {
    if (owner->second == node.name) return;
    throw BadAnswer(fmt::format("published on {}, which belongs to {}", channel, owner->second));
  }
  for (const std::size_t receiver : receivers(channel)) {
    if (nodes_[receiver].name == node.name) continue;
    throw BadAnswer(fmt::format("published on {}, which {} receives and no node of this run owns",
                                printable(channel, kLongestNameShown), nodes_[receiver].name));
  }
}

void GrantSchedule::answer(std::int64_t id, const Grant& grant, const EventKey& next,
                           const std::vector<Publication>& published) {
  Node& node = nodes_[grant.node];
  check(node, grant, next, published);
  if (next <= node.granted_from && node.granted_from < grant.until) {
    throw BadAnswer(fmt::format("did not act on its event at t = {:.6f} s",
                                to_seconds(node.granted_from.when)));
  }
  node.next = {next.when, next.order, static_cast<std::int32_t>(grant.node)};
  for (const Publication& p : published) {
    node.numbers[p.channel] = p.number;
    const std::uint64_t order =
        TimerQueue::order_of(Priority::delivery, first_insertion(id) + p.index);
    for (const std::size_t receiver : receivers(p.channel)) {
      nodes_[receiver].waiting.push_back({grant.node, p, order});
    }
  }
}

const std::vector<std::size_t>& GrantSchedule::receivers(const std::string& channel) {
  const auto known = receivers_.find(channel);
  if (known != receivers_.end()) return known->second;
  std::vector<std::size_t> found;
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    const auto& patterns = nodes_[i].subscriptions;
    const bool wants = std::any_of(patterns.begin(), patterns.end(),
                                   [&](const Pattern& p) { return p.matches(channel); });
    if (wants) found.push_back(i);
  }
  return receivers_.emplace(channel, std::move(found)).first->second;
}

}  // namespace tether
