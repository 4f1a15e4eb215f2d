#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "common/lcm/lockstep_bus.hpp"
#include "common/lcm/lockstep_member.hpp"
#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/node.hpp"
#include "common/scenario/scenario.hpp"

namespace tether {

/// The nodes that take part in a scenario's run in lockstep, by rank.
std::vector<std::string> lockstep_nodes_of(const Scenario& scenario);

/// Coordinator and nodes of a run in lockstep in one thread, but for one node, the guest, which is
/// on a network. What they say to each other never leaves the process; what the guest subscribes
/// to, or is addressed to it, goes out. Of what comes in, only what may be the guest's reaches
/// them: unknown senders on the network cannot join as another node or grant time.
class HostedNodes {
 public:
  /// `io` and `wire` must outlive it. `nodes`: all, the guest among them.
  HostedNodes(const Scenario& scenario, std::int64_t session, const std::vector<std::string>& nodes,
              const std::string& guest, EventLoop& io, Bus& wire);
  HostedNodes(const HostedNodes&) = delete;
  HostedNodes& operator=(const HostedNodes&) = delete;

  /// The coordinator's.
  Bus& bus() { return coordinator_; }
  /// Makes the nodes, which join at once; after the coordinator has subscribed.
  void join();
  /// Why a node has ended the run; empty if none has.
  std::string error() const;

 private:
  /// Access of one of them to the network: all but its own messages.
  class Port final : public Bus {
   public:
    explicit Port(HostedNodes& hosts) : hosts_(hosts) {}
    void publish(std::string_view channel, std::span<const std::uint8_t> bytes) override {
      hosts_.publish(this, channel, bytes);
    }
    void subscribe(const std::string&, int, Handler handler) override {  // to all there is
      handlers_.push_back(std::move(handler));
    }
    void hear(const Message& message) const {
      for (const Handler& handler : handlers_) handler(message);
    }

   private:
    HostedNodes& hosts_;
    std::vector<Handler> handlers_;
  };
  struct Program {
    explicit Program(HostedNodes& hosts) : port(hosts) {}
    Port port;
    std::unique_ptr<LockstepMember> member;
    std::unique_ptr<Node> node;
  };

  void publish(const Port* from, std::string_view channel, std::span<const std::uint8_t> bytes);
  void deliver(const Port* from, const Message& message) const;
  bool goes_out(std::string_view channel, std::span<const std::uint8_t> bytes);
  void on_wire(const Message& message);

  const Scenario& scenario_;
  std::int64_t session_;
  std::vector<std::string> nodes_;
  std::string guest_;
  EventLoop& io_;
  Bus& wire_;
  ChannelFilter guest_wants_;
  std::int64_t guest_instance_ = -1;
  Port coordinator_{*this};
  std::deque<Program> programs_;
};

}  // namespace tether
