#include "onboard/autonomy/autonomy_node.hpp"

#include <algorithm>
#include <limits>
#include <tether/autonomy_state_t.hpp>

#include "common/node/timer_queue.hpp"
#include "common/vehicle/plan.hpp"

namespace tether {
namespace {

static_assert(static_cast<int>(DriveState::autonomous) == autonomy_state_t::AUTONOMOUS);
static_assert(static_cast<int>(DriveState::protective_stop) == autonomy_state_t::PROTECTIVE_STOP);
static_assert(static_cast<int>(DriveState::remote_requested) == autonomy_state_t::REMOTE_REQUESTED);
static_assert(static_cast<int>(DriveState::remote) == autonomy_state_t::REMOTE);
static_assert(static_cast<int>(DriveState::returning) == autonomy_state_t::RETURNING);

}  // namespace

AutonomyNode::AutonomyNode(const AutonomyNodeSettings& settings, EventLoop& loop, Bus& bus)
    : loop_(loop),
      bus_(bus),
      channels_(settings.get<VehicleSettings>().name),
      senders_(loop, bus, {channels_.vehicle_command, channels_.vehicle_plan}),
      clock_offset_(from_seconds(settings.get<VehicleSettings>().clock_offset_ms * 1e-3)),
      driver_(settings),
      sighted_(mapped_shapes(settings)),
      scan_(earliest_stamp(settings)),
      odometry_(earliest_stamp(settings)),
      pose_(earliest_stamp(settings)),
      localisation_(earliest_stamp(settings)),
      counters_(loop, bus, "autonomy", channels_.autonomy_counters,
                from_seconds(settings.get<RunSettings>().report_period_s),
                [this](CounterList& out) { list_counters(out); }) {
  subscribe_to_senses();
  subscribe_to_remote();
  const Duration period = from_seconds(1.0 / settings.get<AutonomySettings>().rate_hz);
  loop.every(first_tick(from_seconds(settings.get<RunSettings>().lead_s), period), period,
             Priority::node, [this](Instant) { step(); });
}

void AutonomyNode::subscribe_to_senses() {
  subscribe_in_run<scan_t>(bus_, loop_, channels_.vehicle_scan, kDeepQueue, scan_.rejected,
                           [this](const scan_t& m) { on_scan(m); });
  subscribe<odometry_t>(bus_, channels_.vehicle_odometry, kDeepQueue,
                        odometry_.rejected.undecodable,
                        [this](const odometry_t& m) { on_odometry(m); });
  subscribe_in_run<pose_t>(bus_, loop_, channels_.vehicle_pose, kDeepQueue, pose_.rejected,
                           [this](const pose_t& m) { on_pose(m); });
  subscribe_in_run<localisation_t>(
      bus_, loop_, channels_.vehicle_localisation, kDeepQueue, localisation_.rejected,
      [this](const localisation_t& m) {
        if (!localisation_.guard.accept(vehicle_time(), from_utime(m.utime), m.seq)) return;
        driver_.on_localisation(m.state != localisation_t::SEARCHING);
      });
}

void AutonomyNode::subscribe_to_remote() {
  subscribe_in_run<twist_t>(bus_, loop_, channels_.vehicle_command, kDeepQueue, rejected_commands_,
                            [this](const twist_t& m) { on_command(m); });
  subscribe_to_plans(bus_, loop_, channels_, rejected_plans_, [this](PlanSource source, Plan plan) {
    driver_.on_senders(!senders_.trouble().empty());
    driver_.on_plan(vehicle_time(), source, std::move(plan));
  });
}

void AutonomyNode::on_scan(const scan_t& message) {
  const std::optional<Scan> scan = to_scan(message);
  if (!scan) {
    ++scan_.unusable;
  } else if (scan_.guard.accept(vehicle_time(), scan->stamp, scan->seq)) {
    driver_.on_scan(*scan);
  }
}

void AutonomyNode::on_odometry(const odometry_t& m) {
  const Pose2 pose{m.x_m, m.y_m, m.yaw_rad};
  const Twist twist{m.v_mps, m.omega_radps};
  const Instant stamp = from_utime(m.utime);
  if (!is_usable(pose) || !is_usable(twist)) {
    ++odometry_.unusable;
  } else if (odometry_.guard.accept(vehicle_time(), stamp, m.seq)) {
    driver_.on_odometry(stamp, pose, twist);
  }
}

void AutonomyNode::on_pose(const pose_t& m) {
  const Pose2 pose{m.x_m, m.y_m, m.yaw_rad};
  const Instant stamp = from_utime(m.utime);
  if (!is_usable(pose)) {
    ++pose_.unusable;
  } else if (pose_.guard.accept(vehicle_time(), stamp, m.seq)) {
    driver_.on_pose(stamp, pose);
  }
}

void AutonomyNode::on_command(const twist_t& m) {
  const Twist twist{m.v_mps, m.omega_radps};
  if (!is_usable(twist)) {
    ++unusable_commands_;
    return;
  }
  driver_.on_senders(!senders_.trouble().empty());
  driver_.on_command(vehicle_time(), from_utime(m.utime), m.seq, twist, pose_time(m.pose_utime));
}

void AutonomyNode::step() {
  const Instant now = vehicle_time();
  driver_.on_senders(!senders_.trouble().empty());
  const DriveState before = last_.state;
  last_ = driver_.step(now);
  // Before the setpoint: who drives is known when it moves.
  if (last_.state != before || !reported_ || now - *reported_ >= kReportPeriod) report(now);
  twist_t drive{};
  drive.utime = to_utime(now);
  drive.seq = steps_++;
  drive.run = loop_.run_id();
  drive.pose_utime = -1;
  drive.v_mps = last_.setpoint.v_mps;
  drive.omega_radps = last_.setpoint.omega_radps;
  publish(bus_, channels_.vehicle_drive, drive);
}

void AutonomyNode::report(Instant now) {
  reported_ = now;
  const Supervisor& supervisor = driver_.supervisor();
  autonomy_state_t m{};
  m.utime = to_utime(now);
  m.seq = reports_++;
  m.run = loop_.run_id();
  m.state = static_cast<std::int32_t>(last_.state);
  m.state_name = to_string(last_.state);
  m.reason = supervisor.reason();
  m.handover = supervisor.handover();
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  const Pose2 pose = last_.pose.value_or(Pose2{kUnknown, kUnknown, kUnknown});
  m.x_m = pose.x_m;
  m.y_m = pose.y_m;
  m.yaw_rad = pose.yaw_rad;
  m.v_mps = last_.setpoint.v_mps;
  m.omega_radps = last_.setpoint.omega_radps;
  m.clear_m = last_.clear_m;
  m.field_m = last_.field_m;
  m.path_s_m = driver_.follower().way_m();
  m.late_s = driver_.late_s(now);
  if (last_.pose) {
    const auto unmapped =
        sighted_.unmapped(driver_.field().points(), pose, autonomy_state_t::MAX_COUNT);
    m.count = static_cast<std::int32_t>(unmapped.size());
    for (const Position& p : unmapped) {
      m.obstacle_x_m.push_back(static_cast<float>(p.x_m));
      m.obstacle_y_m.push_back(static_cast<float>(p.y_m));
    }
  }
  publish(bus_, channels_.vehicle_autonomy, m);
}

void AutonomyNode::finish() {
  report(vehicle_time());
  counters_.publish_now();
}

void AutonomyNode::Input::list(const std::string& name, CounterList& out) const {
  guard.list(name, out);
  rejected.list(name, out);
  out.emplace_back(name + ".unusable", unusable);
}

void AutonomyNode::list_counters(CounterList& out) const {
  scan_.list("scan", out);
  odometry_.list("odometry", out);
  pose_.list("pose", out);
  localisation_.list("localisation", out);
  rejected_commands_.list("command", out);
  out.emplace_back("command.unusable", unusable_commands_);
  senders_.list(out);
  driver_.list(out);
}

}  // namespace tether
