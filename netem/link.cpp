#include "netem/link.hpp"

#include <algorithm>
#include <boost/random/uniform_01.hpp>
#include <utility>

namespace tether {

struct Link::Later {
  bool operator()(const Entry& a, const Entry& b) const {
    return a.departure != b.departure ? a.departure > b.departure : a.number > b.number;
  }
};

Link::Link(const Config& config, std::shared_ptr<StateProcess> state, RandomEngine loss)
    : config_(config), state_(std::move(state)), loss_(loss) {}

const ChannelStateConfig& Link::parameters() const {
  return config_.states[static_cast<std::size_t>(state_->state())];
}

Instant Link::push(Instant now, Packet packet) {
  state_->advance(now);
  const std::int64_t number = counters_.offered++;
  const double luck = boost::random::uniform_01<double>()(loss_);
  if (luck >= parameters().prr) {
    ++counters_.lost;
    return Instant::max();
  }
  if (in_flight() >= config_.queue_limit) {
    ++counters_.overflowed;
    return Instant::max();
  }
  const Instant departure = now + from_seconds(parameters().delay_ms * 1e-3);
  queue_.push_back({departure, number, now, std::move(packet)});
  std::push_heap(queue_.begin(), queue_.end(), Later{});
  return departure;
}

Instant Link::next_event() const {
  return queue_.empty() ? Instant::max() : queue_.front().departure;
}

void Link::pop_ready(Instant now, const std::function<void(const Packet&)>& deliver) {
  while (next_event() <= now) {
    std::pop_heap(queue_.begin(), queue_.end(), Later{});
    const Entry entry = std::move(queue_.back());
    queue_.pop_back();
    ++counters_.delivered;
    counters_.delivered_bytes += static_cast<std::int64_t>(entry.packet.bytes.size());
    delays_.add(now - entry.arrival);
    deliver(entry.packet);
  }
}

namespace {

Link::Config link_config(const LinkConfig& c) {
  if (c.model == LinkConfig::Model::fixed) return {{c.fixed, c.fixed}, c.queue_limit};
  return {{c.good, c.bad}, c.queue_limit};
}

std::shared_ptr<StateProcess> state_process(const LinkConfig& c, RandomEngine random) {
  return std::make_shared<StateProcess>(
      c.model == LinkConfig::Model::fixed
          ? StateProcess::fixed()
          : StateProcess::markov(c.mean_good_s, c.mean_bad_s, random));
}

}  // namespace

LinkPair make_links(const Scenario& scenario) {
  const Scenario::Channel& channel = scenario.channel;
  const auto stream = [&scenario](const std::string& purpose) {
    return random_stream(scenario.run.seed, scenario.vehicle.name + "/" + purpose);
  };
  const auto uplink_state = state_process(channel.uplink, stream("uplink/state"));
  const auto downlink_state = channel.shared_state
                                  ? uplink_state
                                  : state_process(channel.downlink, stream("downlink/state"));
  return {Link(link_config(channel.uplink), uplink_state, stream("uplink/loss")),
          Link(link_config(channel.downlink), downlink_state, stream("downlink/loss"))};
}

}  // namespace tether
