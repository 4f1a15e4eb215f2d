#include "tools/runs/fleet_observer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <utility>

#include "common/onboard/onboard_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "tools/runs/run_summary.hpp"

namespace tether {
namespace {

/// Each vehicle's part of a program counts them (CounterReporter).
bool is_of_the_program(const std::string& name) {
  return name.ends_with(".loop.slips") || name.ends_with(".network.datagrams_dropped");
}

}  // namespace

FleetObserver::FleetObserver(const std::vector<Scenario>& members, EventLoop& loop, Bus& bus) {
  for (const Scenario& member : members) {
    observers_.push_back(std::make_unique<const RunObserver>(member, loop, bus));
    vehicles_.push_back(observers_.back().get());
    names_.push_back(member.get<VehicleSettings>().name);
    poses_come_from_relay_.push_back(member.get<LocaliserSettings>().place !=
                                     LocaliserSettings::Place::edge);
  }
}

std::map<std::string, std::int64_t> FleetObserver::counters() const {
  std::map<std::string, std::int64_t> counters;
  for (const RunObserver* vehicle : vehicles_) {
    for (const auto& [name, value] : vehicle->counters()) {
      std::int64_t& sum = counters[name];
      sum = is_of_the_program(name) ? std::max(sum, value) : sum + value;
    }
  }
  return counters;
}

void FleetObserver::check_commands() const {
  constexpr std::array<std::pair<const char*, const char*>, 4> kNone{{
      {"sim.command.non_finite", "numbers that are not finite"},
      {"sim.command.undecodable", "bytes that are no twist"},
      {"sim.plan.unasked", "plans without actuator.policy = \"horizon\""},
      {"sim.plan.undecodable", "bytes that are no plan"},
  }};
  for (std::size_t i = 0; i < vehicles_.size(); ++i) {
    for (const auto& [counter, what] : kNone) {
      const std::int64_t count = vehicles_[i]->counter(counter);
      if (count == 0) continue;
      throw std::runtime_error(
          fmt::format("{} got {} messages from the controller that are no commands to it: {} ({})",
                      names_[i], count, what, counter));
    }
  }
  for (const std::string& what : {refused_commands(), jumps()}) {
    if (!what.empty()) throw std::runtime_error(what);
  }
}

std::string FleetObserver::refused_commands() const {
  for (std::size_t i = 0; i < vehicles_.size(); ++i) {
    std::int64_t accepted = 0, refused = 0;
    std::string reasons;
    for (const char* kind :
         {"sim.command.", "sim.plan.", "can_bridge.command.", "can_bridge.plan."}) {
      accepted += vehicles_[i]->counter(std::string(kind) + "accepted");
      for (const char* reason :
           {"other_run", "from_future", "before_start", "invalid_seq", "time_backwards"}) {
        const std::int64_t count = vehicles_[i]->counter(std::string(kind) + reason);
        refused += count;
        if (count > 0)
          reasons += fmt::format("{}{}{} {}", reasons.empty() ? "" : ", ", kind, reason, count);
      }
    }
    if (accepted > 0 || refused == 0) continue;
    return fmt::format("{} refused all {} commands that reached it: {}", names_[i], refused,
                       reasons);
  }
  return "";
}

std::string FleetObserver::streams_with(const std::string& kind) const {
  std::string found;
  for (std::size_t i = 0; i < vehicles_.size(); ++i) {
    const auto counters = vehicles_[i]->counters();
    for (const auto& [name, count] : counters) {
      if (!name.ends_with(kind) || count == 0) continue;
      const std::string stream = name.substr(0, name.size() - kind.size());
      if (!counters.contains(stream + ".accepted")) continue;  // counts something else
      found += fmt::format("{}{}: {} {}", found.empty() ? "" : ", ", names_[i], name, count);
    }
  }
  return found;
}

std::string FleetObserver::jumps() const {
  const std::string found = streams_with(".jumped");
  return found.empty() ? "" : "numbers of messages jumped further than losses explain: " + found;
}

std::string FleetObserver::restarts() const {
  const std::string found = streams_with(".restarts");
  return found.empty()
             ? ""
             : "numbers of messages began again, though no sender has restarted: " + found;
}

std::string FleetObserver::surplus() const {
  std::string found;
  const auto compare = [&found](const std::string& name, const char* what, std::int64_t came,
                                std::int64_t delivered) {
    if (came <= delivered) return;
    found += fmt::format("{}{} {} of {} came, and the relay delivered {}",
                         found.empty() ? "" : ", ", came, what, name, delivered);
  };
  for (std::size_t i = 0; i < vehicles_.size(); ++i) {
    const RunObserver& vehicle = *vehicles_[i];
    if (poses_come_from_relay_[i])
      compare(names_[i], "poses", vehicle.poses_received(), vehicle.uplink().delivered);
    compare(names_[i], "commands", vehicle.commands_received(), vehicle.downlink().delivered);
  }
  return found.empty() ? "" : "another program sent messages in the relay's name: " + found;
}

void FleetObserver::check_finite() const {
  for (const RunObserver* vehicle : vehicles_) tether::check_finite(*vehicle);
}

}  // namespace tether
