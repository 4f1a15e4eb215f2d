#include "tools/nodes/hosted_nodes.hpp"

#include <algorithm>
#include <tether/time_grant_t.hpp>
#include <tether/time_join_t.hpp>
#include <tether/time_resend_t.hpp>
#include <tether/time_welcome_t.hpp>
#include <utility>

#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "common/lcm/lockstep_bus.hpp"
#include "common/node/message_io.hpp"
#include "common/node/node.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/onboard_settings.hpp"
#include "netem/relay/netem_node.hpp"
#include "onboard/autonomy/autonomy_node.hpp"
#include "onboard/localiser/localiser_node.hpp"
#include "sim/node/sim_node.hpp"
#include "tools/nodes/can_loop.hpp"

namespace tether {
namespace {

struct Drivetrain final : Node {
  Drivetrain(const Scenario& scenario, EventLoop& loop, Bus& bus) : can(scenario, loop, bus) {}
  void finish() override { can.finish(); }
  CanLoop can;
};

std::unique_ptr<Node> make_node(const std::string& name, const Scenario& scenario, EventLoop& loop,
                                Bus& bus) {
  const std::vector<Scenario> members = fleet_members(scenario);
  if (name == "sim") return std::make_unique<SimFleet>(members, loop, bus);
  if (name == "netem") return relays_of(members, loop, bus, bus);
  if (name == "can") return std::make_unique<Drivetrain>(scenario, loop, bus);
  if (name == "localiser") {
    return group_of<LocaliserNode>(members_with(has_localiser, members), loop, bus);
  }
  return group_of<AutonomyNode>(members_with(has_autonomy, members), loop, bus);
}

}  // namespace

std::vector<std::string> lockstep_nodes_of(const Scenario& scenario) {
  std::vector<std::string> nodes = lockstep_nodes();
  if (scenario.get<VehicleSettings>().drivetrain != VehicleSettings::Drivetrain::can) {
    std::erase(nodes, "can");
  }
  const std::vector<Scenario> members = fleet_members(scenario);
  if (members_with(has_localiser, members).empty()) std::erase(nodes, "localiser");
  if (members_with(has_autonomy, members).empty()) std::erase(nodes, "autonomy");
  return nodes;
}

HostedNodes::HostedNodes(const Scenario& scenario, std::int64_t session,
                         const std::vector<std::string>& nodes, const std::string& guest,
                         EventLoop& io, Bus& wire)
    : scenario_(scenario), session_(session), nodes_(nodes), guest_(guest), io_(io), wire_(wire) {
  wire_.subscribe(".*", kDeepQueue, [this](const Message& message) { on_wire(message); });
}

void HostedNodes::join() {
  const Instant start = kStart - from_seconds(scenario_.get<RunSettings>().lead_s);
  for (const std::string& name : nodes_) {
    if (name == guest_) continue;
    Program& p = programs_.emplace_back(*this);
    p.member = std::make_unique<LockstepMember>(
        LockstepMember::Config{.session = session_, .instance = 1, .name = name, .start = start},
        io_, p.port);
    p.node = make_node(name, scenario_, p.member->loop(), p.member->bus());
    p.member->join(*p.node);
  }
}

std::string HostedNodes::error() const {
  for (const Program& p : programs_) {
    if (!p.member->error().empty()) return p.member->error();
  }
  return "";
}

void HostedNodes::publish(const Port* from, std::string_view channel,
                          std::span<const std::uint8_t> bytes) {
  io_.at(io_.now(), Priority::delivery,
         [this, from, name = std::string(channel),
          data = std::vector<std::uint8_t>(bytes.begin(), bytes.end())](Instant) {
           deliver(from, {name, data});
         });
  if (goes_out(channel, bytes)) wire_.publish(channel, bytes);
}

void HostedNodes::deliver(const Port* from, const Message& message) const {
  if (from != &coordinator_) coordinator_.hear(message);
  for (const Program& p : programs_) {
    if (from != &p.port) p.port.hear(message);
  }
}

bool HostedNodes::goes_out(std::string_view channel, std::span<const std::uint8_t> bytes) {
  if (!channel.starts_with(kTimePrefix)) return guest_wants_.matches(channel);
  if (channel == kTimeGrant) {
    time_grant_t grant{};
    return decode(bytes, grant) && grant.node == guest_;
  }
  if (channel == kTimeWelcome) {
    time_welcome_t welcome{};
    return decode(bytes, welcome) && (welcome.node.empty() || welcome.node == guest_);
  }
  time_resend_t resend{};
  return channel == kTimeResend && decode(bytes, resend) && resend.publisher == guest_;
}

void HostedNodes::on_wire(const Message& message) {
  if (message.channel == kTimeGrant || message.channel == kTimeWelcome) return;
  if (message.channel == kTimeJoin) {
    time_join_t join{};
    if (!decode(message.bytes, join) || join.node != guest_) return;
    if (guest_instance_ != join.instance) {
      guest_instance_ = join.instance;
      try {
        for (const std::string& channels : join.subscription) guest_wants_.add(channels);
      } catch (const UsageError&) {  // the coordinator says so
      }
    }
  }
  deliver(nullptr, message);
}

}  // namespace tether
