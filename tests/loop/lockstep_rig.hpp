#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "common/fleet/fleet.hpp"
#include "common/lcm/lockstep_bus.hpp"
#include "common/lcm/lockstep_member.hpp"
#include "common/node/message_io.hpp"
#include "common/node/node.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/world/onboard_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/node/controller_node.hpp"
#include "netem/relay/netem_node.hpp"
#include "onboard/autonomy/autonomy_node.hpp"
#include "onboard/localiser/localiser_node.hpp"
#include "sim/node/sim_node.hpp"
#include "tests/support/peer_bus.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/nodes/time_manager.hpp"

namespace tether::test {

/// Faults of a line between a program and the network, in the direction to the network.
struct LineFaults {
  double lost = 0.0, doubled = 0.0, delayed = 0.0;  ///< shares
  std::function<bool(const Message&)> swallow = [](const Message&) { return false; };
  std::function<bool(const Message&)> deaf_to = [](const Message&) { return false; };
};

/// A program's access to a network that loses, doubles and delays.
class BadLine final : public Bus {
 public:
  BadLine(InProcessBus& network, EventLoop& wall, unsigned seed)
      : wall_(wall), peer_(network, wall), random_(seed) {}

  void publish(std::string_view channel, std::span<const std::uint8_t> bytes) override {
    if (faults.swallow({channel, bytes}) || chance(faults.lost)) return;
    const int copies = chance(faults.doubled) ? 2 : 1;
    for (int i = 0; i < copies; ++i) {
      const auto delay = chance(faults.delayed) ? std::chrono::microseconds{random_() % 300'000}
                                                : std::chrono::microseconds{20};
      wall_.at(wall_.now() + delay, Priority::delivery,
               [this, name = std::string(channel),
                data = std::vector<std::uint8_t>(bytes.begin(), bytes.end())](Instant) {
                 peer_.publish(name, data);
               });
    }
  }
  void subscribe(const std::string& channel_regex, int capacity, Handler handler) override {
    peer_.subscribe(channel_regex, capacity, [this, handler](const Message& message) {
      if (!faults.deaf_to(message)) handler(message);
    });
  }

  LineFaults faults;

 private:
  bool chance(double p) { return p > 0.0 && std::uniform_real_distribution<>(0, 1)(random_) < p; }

  EventLoop& wall_;
  PeerBus peer_;
  std::mt19937 random_;
};

/// All that was recorded, to compare.
class Record {
 public:
  void add(Instant when, const Message& message) {
    text_ += std::to_string(to_utime(when)) + " " + std::string(message.channel) + " ";
    text_.append(message.bytes.begin(), message.bytes.end());
    ++messages_;
  }
  std::size_t hash() const { return std::hash<std::string>{}(text_); }
  std::int64_t messages() const { return messages_; }
  bool operator==(const Record& other) const { return text_ == other.text_; }

 private:
  std::string text_;
  std::int64_t messages_ = 0;
};

inline Record record_of(const Scenario& scenario) {
  ClosedLoop loop(scenario);
  Record record;
  loop.bus().subscribe(".*", kDeepQueue,
                       [&](const Message& message) { record.add(loop.loop().now(), message); });
  loop.run();
  return record;
}

/// Coordinator and nodes, each with a line of its own; wall time is virtual.
class LockstepRig {
 public:
  static constexpr std::int64_t kSession = 77;

  /// With controller.external, there is no controller.
  explicit LockstepRig(const Scenario& scenario, const LineFaults& faults = {},
                       Duration patience = std::chrono::seconds{10})
      : scenario_(scenario) {
    TimeManager::Config config;
    config.session = kSession;
    config.nodes = {"sim", "netem", "controller"};
    const std::vector<Scenario> members = fleet_members(scenario);
    if (!members_with(has_localiser, members).empty()) config.nodes.emplace_back("localiser");
    if (!members_with(has_autonomy, members).empty()) config.nodes.emplace_back("autonomy");
    config.owners = channel_owners(members);
    config.patience = patience;
    config.end = kStart + from_seconds(scenario.get<RunSettings>().duration_s);
    manager_line_.faults = faults;
    manager = std::make_unique<TimeManager>(config, wall, manager_line_,
                                            [this](Instant t, const Message& m) {
                                              record.add(t, m);
                                              if (t >= pause_at_) wall.stop();
                                            });
    for (const std::string& name : config.nodes) {
      if (name == "controller" && scenario.get<ControllerSettings>().external) continue;
      join(name, 1).faults = faults;
    }
  }

  /// Another start of a node; its line.
  BadLine& join(const std::string& name, std::int64_t instance) {
    auto p = std::make_unique<Program>(network, wall, static_cast<unsigned>(programs_.size()) + 1);
    p->member = std::make_unique<LockstepMember>(
        LockstepMember::Config{.session = kSession,
                               .instance = instance,
                               .name = name,
                               .start = kStart - from_seconds(scenario_.get<RunSettings>().lead_s)},
        wall, p->line);
    EventLoop& loop = p->member->loop();
    Bus& bus = p->member->bus();
    const std::vector<Scenario> members = fleet_members(scenario_);
    if (name == "sim") p->node = std::make_unique<SimFleet>(members, loop, bus);
    if (name == "netem") p->node = relays_of(members, loop, bus, bus);
    if (name == "localiser") {
      p->node = group_of<LocaliserNode>(members_with(has_localiser, members), loop, bus);
    }
    if (name == "autonomy") {
      p->node = group_of<AutonomyNode>(members_with(has_autonomy, members), loop, bus);
    }
    if (name == "controller") p->node = group_of<ControllerNode>(members, loop, bus);
    p->member->join(*p->node);
    programs_.push_back(std::move(p));
    return programs_.back()->line;
  }

  BadLine& line(std::size_t node) { return programs_[node]->line; }
  BadLine& unknown_sender() { return unknown_sender_; }
  BadLine& manager_line() { return manager_line_; }
  const LockstepMember& member(std::size_t node) const { return *programs_[node]->member; }

  /// Until it is over, but no longer than this in wall time.
  void run(double wall_s = 3600.0) {
    const Instant limit = wall.now() + from_seconds(wall_s);
    while (!manager->done() && manager->error().empty() && wall.now() < limit) {
      wall.run_until(limit);
    }
  }
  /// Until the run's time is this.
  void run_to(Instant when) {
    pause_at_ = when;
    while (manager->now() < when && manager->error().empty()) {
      wall.run_until(wall.now() + std::chrono::seconds{1});
    }
    pause_at_ = Instant::max();
  }

  VirtualLoop wall;
  InProcessBus network{wall};
  Record record;
  std::unique_ptr<TimeManager> manager;

 private:
  struct Program {
    Program(InProcessBus& its_network, EventLoop& its_wall, unsigned seed)
        : line(its_network, its_wall, seed) {}
    BadLine line;
    std::unique_ptr<LockstepMember> member;
    std::unique_ptr<Node> node;
  };
  Scenario scenario_;
  Instant pause_at_ = Instant::max();
  BadLine manager_line_{network, wall, 99};
  BadLine unknown_sender_{network, wall, 98};
  std::vector<std::unique_ptr<Program>> programs_;
};

}  // namespace tether::test
