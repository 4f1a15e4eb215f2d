#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "common/base/pattern.hpp"
#include "common/fleet/channel_owners.hpp"
#include "common/lockstep/bus.hpp"
#include "common/loop/event_key.hpp"

namespace tether {

/// A node's answer contradicts its grant.
struct BadAnswer : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Which node may act next, how far, and with which messages: the conservative next-event rule
/// (docs/reference/time.md). The node whose event comes first acts, up to the first event of any
/// other. Nothing in here knows of sockets or wall time.
class GrantSchedule {
 public:
  struct Delivery {
    std::size_t publisher;
    Publication message;
    std::uint64_t order;  ///< place of the delivery among the events of its instant
  };
  struct Grant {
    std::size_t node;
    EventKey until;
    std::vector<Delivery> deliveries;
  };

  /// Nothing happens after `end`. A node may publish the channels that `owners` gives to it, and
  /// others that neither have an owner nor reach another node.
  explicit GrantSchedule(Instant end, ChannelOwners owners = {})
      : end_(end), owners_(std::move(owners)) {}

  /// In order of rank. Throws UsageError for a subscription that is no regular expression.
  void add_node(std::string name, const std::vector<std::string>& subscriptions,
                const EventKey& next);

  /// The next grant, which must be answered before the next call; nullopt if nothing is left.
  std::optional<Grant> next();

  /// Takes the answer to a grant of next(), or to one that let a node finish (then `grant` has no
  /// deliveries, and the run's end as its bound). Throws BadAnswer.
  void answer(std::int64_t id, const Grant& grant, const EventKey& next,
              const std::vector<Publication>& published);

  /// Whether a channel has an owner, or a node receives it.
  bool concerns(const std::string& channel) {
    return owners_.contains(channel) || !receivers(channel).empty();
  }
  const std::string& name(std::size_t node) const { return nodes_[node].name; }
  std::size_t size() const { return nodes_.size(); }
  /// The earliest event of all; Instant::max() if there is none.
  Instant now() const;

 private:
  struct Node {
    std::string name;
    std::vector<Pattern> subscriptions;
    EventKey next;  // the next of its own events
    std::deque<Delivery> waiting;
    std::map<std::string, std::int64_t> numbers;
    EventKey granted_from{Instant::min(), 0, 0};
  };
  EventKey first_event(std::size_t node) const;
  void check(const Node& node, const Grant& grant, const EventKey& next,
             const std::vector<Publication>& published);
  void check_owner(const Node& node, const std::string& channel);
  const std::vector<std::size_t>& receivers(const std::string& channel);

  Instant end_;
  ChannelOwners owners_;
  std::vector<Node> nodes_;
  std::map<std::string, std::vector<std::size_t>> receivers_;
};

}  // namespace tether
