#include "tools/runs/run_observer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <tether/pose_t.hpp>
#include <utility>

#include "common/base/text.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/onboard_settings.hpp"
#include "tools/runs/run_summary.hpp"

namespace tether {

namespace {

/// Ours are some hundred; anybody can send others.
constexpr std::size_t kMostCounters = 2000;

/// For this many rows there is room from the start.
std::size_t rows_expected(const RunSettings& run) {
  constexpr double kMost = 20'000.0;
  return static_cast<std::size_t>(std::min(run.duration_s * run.truth_rate_hz + 2.0, kMost));
}

StreamGuard::Config from_lead(const Scenario& scenario) {
  return {.earliest = kStart - from_seconds(scenario.get<RunSettings>().lead_s)};
}

}  // namespace

RunObserver::RunObserver(const Scenario& scenario, EventLoop& loop, Bus& bus)
    : loop_(loop),
      uplink_guard_(from_lead(scenario)),
      downlink_guard_(from_lead(scenario)),
      autonomy_guard_(from_lead(scenario)) {
  trajectory_.reserve(rows_expected(scenario.get<RunSettings>()));
  const ChannelNames channels(scenario.get<VehicleSettings>().name);
  subscribe<ground_truth_t>(bus, channels.truth, kDeepQueue, undecodable_,
                            [this](const ground_truth_t& m) { on_truth(m); });
  const auto follow = [&](const std::string& channel, StreamGuard& guard, link_report_t& newest,
                          int TrajectoryRow::*state) {
    subscribe<link_report_t>(bus, channel, kDeepQueue, undecodable_,
                             [this, &guard, &newest, state](const link_report_t& m) {
                               if (!accept(guard, m.utime, m.seq)) return;
                               newest = m;
                               // Among the reports of one instant, the truth may come first.
                               const bool is_of_last_row =
                                   !trajectory_.empty() && truth_.utime == m.utime;
                               if (is_of_last_row) trajectory_.back().*state = m.state;
                             });
  };
  follow(channels.uplink_report, uplink_guard_, uplink_, &TrajectoryRow::uplink_state);
  follow(channels.downlink_report, downlink_guard_, downlink_, &TrajectoryRow::downlink_state);
  std::vector<std::string> reports{channels.sim_counters, channels.net_counters,
                                   channels.control_counters};
  if (scenario.get<VehicleSettings>().drivetrain == VehicleSettings::Drivetrain::can) {
    drivetrain_.emplace(scenario, loop, bus);
    reports.insert(reports.end(), {channels.can_counters, channels.drive_counters});
  }
  if (scenario.get<AutonomySettings>().enabled) reports.push_back(channels.autonomy_counters);
  for (const std::string& channel : reports) {
    subscribe<counters_t>(bus, channel, kDeepQueue, undecodable_,
                          [this, &known = known_[channel]](const counters_t& m) {
                            if (m.node != known.node || m.name != known.names) known = look_up(m);
                            for (std::size_t i = 0; i < m.name.size(); ++i) {
                              if (known.values[i] != nullptr) *known.values[i] = m.value[i];
                            }
                          });
  }
  subscribe<autonomy_state_t>(bus, channels.vehicle_autonomy, kDeepQueue, undecodable_,
                              [this](const autonomy_state_t& m) {
                                if (accept(autonomy_guard_, m.utime, m.seq)) autonomy_ = m;
                              });
  subscribe<pose_t>(bus, channels.control_pose, kDeepQueue, undecodable_,
                    [this](const pose_t& m) { on_pose(from_utime(m.utime)); });
  for (const std::string& channel : {channels.vehicle_command, channels.vehicle_plan}) {
    bus.subscribe(channel, kDeepQueue, [this](const Message&) { ++commands_received_; });
  }
}

RunObserver::KnownCounters RunObserver::look_up(const counters_t& m) {
  KnownCounters known{m.node, m.name, {}};
  for (const std::string& of_node : m.name) {
    const std::string name = printable(m.node + "." + of_node, kLongestNameShown);
    const bool too_many = counters_.size() == kMostCounters && !counters_.contains(name);
    known.values.push_back(too_many ? nullptr : &counters_[name]);
  }
  return known;
}

bool RunObserver::accept(StreamGuard& guard, std::int64_t utime, std::int64_t seq) {
  const bool accepted = guard.accept(loop_.now(), from_utime(utime), seq);
  if (!accepted) ++rejected_;
  return accepted;
}

void RunObserver::on_truth(const ground_truth_t& m) {
  const bool usable =
      is_usable(Pose2{m.x_m, m.y_m, m.yaw_rad}) && is_usable(m.error_m) && is_usable(m.epsilon_m);
  if (!usable) {
    ++rejected_;
    return;
  }
  const std::int64_t restarts = truth_guard_.counters().restarts;
  if (!accept(truth_guard_, m.utime, m.seq)) return;
  if (truth_guard_.counters().restarts > restarts) trajectory_.clear();
  truth_ = m;
  trajectory_.push_back({static_cast<double>(m.utime) * 1e-6, m.x_m, m.y_m, m.yaw_rad, m.x_ref_m,
                         m.y_ref_m, m.error_m, uplink_.state, downlink_.state});
}

void RunObserver::on_pose(Instant stamp) {
  ++poses_received_;
  const Instant now = loop_.now();
  if (now < kStart) return;  // still in the lead time
  age_integral_s2_ = age_integral_s2(now);
  last_pose_arrival_ = now;
  newest_pose_stamp_ = std::clamp(stamp, newest_pose_stamp_, std::max(now, newest_pose_stamp_));
}

std::map<std::string, std::int64_t> RunObserver::counters() const {
  auto counters = counters_;
  counters["observer.undecodable"] = undecodable_;
  counters["observer.rejected"] = rejected_;
  return counters;
}

double RunObserver::age_integral_s2(Instant until) const {
  const double from_age_s = to_seconds(last_pose_arrival_ - newest_pose_stamp_);
  const double to_age_s = to_seconds(until - newest_pose_stamp_);
  return age_integral_s2_ + 0.5 * (to_age_s * to_age_s - from_age_s * from_age_s);
}

double RunObserver::aoi_mean_s(Instant now) const {
  const double elapsed_s = to_seconds(now);
  return elapsed_s > 0.0 ? age_integral_s2(now) / elapsed_s : 0.0;
}

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
