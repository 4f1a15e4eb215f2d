#include "tools/runs/run_observer.hpp"

#include <algorithm>
#include <tether/pose_t.hpp>

#include "common/base/text.hpp"
#include "common/bus/channel_names.hpp"
#include "common/bus/message_io.hpp"
#include "common/onboard/onboard_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_settings.hpp"

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

}  // namespace tether
