#include "controller/controller_node.hpp"

#include <tether/controller_report_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/twist_t.hpp>

#include "common/make_path.hpp"
#include "common/message_io.hpp"

namespace tether {

ControllerNode::ControllerNode(const Scenario& scenario, EventLoop& loop, Bus& bus)
    : loop_(loop),
      bus_(bus),
      channels_(scenario.vehicle.name),
      config_(scenario.controller),
      pose_timeout_(from_seconds(config_.pose_timeout_s)),
      law_(config_, make_path(scenario.path)),
      guard_({.earliest = kStart - from_seconds(scenario.run.lead_s)}),
      counters_(loop, bus, "controller", channels_.control_counters,
                from_seconds(scenario.run.report_period_s),
                [this](CounterList& out) { list_counters(out); }) {
  subscribe<pose_t>(bus, channels_.control_pose, 1, undecodable_, [this](const pose_t& m) {
    on_pose(from_utime(m.utime), m.seq, {m.x_m, m.y_m, m.yaw_rad});
  });
  if (config_.trigger == Scenario::Controller::Trigger::timer) {
    const Duration period = from_seconds(1.0 / config_.rate_hz);
    loop.every(first_tick(from_seconds(scenario.run.lead_s), period), period, Priority::node,
               [this](Instant) { decide(); });
  }
}

void ControllerNode::on_pose(Instant stamp, std::int64_t seq, const Pose2& pose) {
  if (!is_usable(pose)) {
    ++non_finite_;
    return;
  }
  if (!guard_.accept(loop_.now(), stamp, seq)) return;
  have_pose_ = true;
  pose_ = pose;
  pose_stamp_ = stamp;
  pose_seq_ = seq;
  if (config_.trigger == Scenario::Controller::Trigger::timer) return;
  decide();
  if (pose_timeout_ > Duration{0} && !timed_out(loop_.now())) {
    loop_.at(stamp + pose_timeout_, Priority::node, [this](Instant) { on_possible_timeout(); });
  }
}

void ControllerNode::on_possible_timeout() {
  // A newer pose may have come since this was scheduled.
  if (timed_out(loop_.now())) decide();
}

bool ControllerNode::timed_out(Instant now) const {
  return pose_timeout_ > Duration{0} && now - pose_stamp_ >= pose_timeout_;
}

void ControllerNode::decide() {
  const Instant now = loop_.now();
  if (!have_pose_ || now < kStart) {
    send(now, {}, false);
  } else if (timed_out(now)) {
    ++pose_timeouts_;
    law_.reset();
    send(now, {}, true);
  } else {
    Twist twist = law_.step(pose_, now);
    if (!is_usable(twist)) {  // no input is known to lead here; NaN must not leave, nor stay inside
      ++unusable_commands_;
      law_.reset();
      twist = {};
    }
    send(now, twist, false);
  }
}

void ControllerNode::send(Instant now, const Twist& twist, bool stopped) {
  const std::int64_t pose_utime = have_pose_ ? to_utime(pose_stamp_) : -1;

  twist_t command{};
  command.utime = to_utime(now);
  command.seq = commands_;
  command.pose_utime = pose_utime;
  command.v_mps = twist.v_mps;
  command.omega_radps = twist.omega_radps;
  publish(bus_, channels_.control_command, command);

  controller_report_t report{};
  report.utime = to_utime(now);
  report.seq = commands_++;
  report.pose_utime = pose_utime;
  report.pose_seq = pose_seq_;
  report.pose_age_s = have_pose_ ? to_seconds(now - pose_stamp_) : 0.0;
  report.heading_error_rad = law_.errors().heading_rad;
  report.distance_error_m = law_.errors().distance_m;
  report.v_mps = twist.v_mps;
  report.omega_radps = twist.omega_radps;
  report.pose_timed_out = stopped ? 1 : 0;
  publish(bus_, channels_.control_report, report);
}

void ControllerNode::finish() { counters_.publish_now(); }

void ControllerNode::list_counters(CounterList& out) const {
  guard_.list("pose", out);
  out.emplace_back("pose.undecodable", undecodable_);
  out.emplace_back("pose.non_finite", non_finite_);
  out.emplace_back("pose.timeouts", pose_timeouts_);
  out.emplace_back("command.unusable", unusable_commands_);
  out.emplace_back("command.sent", commands_);
}

}  // namespace tether
