#include "controller/node/controller_node.hpp"

#include <algorithm>
#include <cmath>
#include <tether/controller_report_t.hpp>
#include <tether/plan_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/twist_t.hpp>
#include <variant>

#include "common/base/random.hpp"
#include "common/node/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"

namespace tether {
namespace {

bool stands(const LawOutput& decision) {
  if (const auto* plan = std::get_if<Plan>(&decision)) return plan->is_stop();
  const auto& twist = std::get<Twist>(decision);
  return twist.v_mps == 0.0 && twist.omega_radps == 0.0;
}

/// Mean twist of `plan` from `t` on for `during`, which is at most one of its steps.
Twist mean(const Plan& plan, Instant t, Duration during) {
  const Twist &first = plan.at(t), &then = plan.at(t + during);
  const Duration into = (t - plan.start) % plan.step;
  const Duration second = std::max(Duration{0}, into + during - plan.step);
  const double share = to_seconds(second) / to_seconds(during);
  return {first.v_mps + share * (then.v_mps - first.v_mps),
          first.omega_radps + share * (then.omega_radps - first.omega_radps)};
}

}  // namespace

CommandSending::CommandSending(const ControllerSettings& settings)
    : delta_mps_(settings.send_delta_mps),
      delta_radps_(settings.send_delta_radps),
      max_age_(from_seconds(settings.send_max_age_s)) {
  if (settings.trigger == ControllerSettings::Trigger::timer) {
    period_ = from_seconds(1.0 / settings.rate_hz);
  }
}

bool CommandSending::is_due(Instant now, const LawOutput& decision, bool stopped,
                            const SeenPose* newest) {
  const auto is_late = [&] {
    const Duration age = now - last_at_;
    return period_ > Duration{0} ? age + period_ > max_age_ : age >= max_age_;
  };
  if (!stopped && last_ && !is_late() && !is_missed(newest) && !differs(decision)) return false;
  last_ = decision;
  last_at_ = now;
  return true;
}

bool CommandSending::is_missed(const SeenPose* newest) const {
  const auto* sent = std::get_if<Plan>(&*last_);
  return sent != nullptr && newest != nullptr && newest->stamp >= sent->start &&
         newest->plan_id != sent->name.id;
}

bool CommandSending::differs(const Twist& a, const Twist& b) const {
  return std::abs(a.v_mps - b.v_mps) > delta_mps_ ||
         std::abs(a.omega_radps - b.omega_radps) > delta_radps_;
}

bool CommandSending::differs(const LawOutput& decision) const {
  if (decision.index() != last_->index() || stands(decision) != stands(*last_)) return true;
  if (const auto* plan = std::get_if<Plan>(&decision))
    return differs(*plan, std::get<Plan>(*last_));
  return differs(std::get<Twist>(decision), std::get<Twist>(*last_));
}

bool CommandSending::differs(const Plan& plan, const Plan& sent) const {
  if (plan.start < sent.start || plan.start + plan.step > sent.end() || plan.step != sent.step) {
    return true;
  }
  Instant t = plan.start;
  for (const Twist& twist : plan.twists) {
    if (t + plan.step > sent.end()) break;
    if (differs(twist, mean(sent, t, plan.step))) return true;
    t += plan.step;
  }
  return false;
}

namespace {

/// Never negative: −1 means "no session".
std::int64_t session_of_seed(std::uint64_t seed) {
  RandomEngine random = random_stream(seed, "controller/session");
  return static_cast<std::int64_t>(random() >> 1U);
}

/// A controller that begins later was restarted: the vehicle has left its start.
constexpr Duration kLatestStart = std::chrono::seconds{1};

bool is_start_known(const ControllerNodeSettings& settings, Instant begun) {
  const auto& localiser = settings.get<LocaliserSettings>();
  const bool declared = localiser.place == LocaliserSettings::Place::none || localiser.knows_start;
  return declared && begun <= kStart + kLatestStart;
}

bool is_usable(const LawOutput& decision) {
  if (const auto* twist = std::get_if<Twist>(&decision)) return tether::is_usable(*twist);
  const auto& twists = std::get<Plan>(decision).twists;
  return !twists.empty() && std::all_of(twists.begin(), twists.end(), [](const Twist& twist) {
    return tether::is_usable(twist);
  });
}

}  // namespace

ControllerNode::ControllerNode(const ControllerNodeSettings& settings, EventLoop& loop, Bus& bus,
                               std::optional<std::int64_t> session, std::unique_ptr<Law> law)
    : loop_(loop),
      bus_(bus),
      channels_(settings.get<VehicleSettings>().name),
      senders_(loop, bus, {channels_.control_pose, channels_.control_odometry}),
      config_(settings.get<ControllerSettings>()),
      pose_timeout_(from_seconds(config_.pose_timeout_s)),
      begun_(std::max(loop.now(), kStart)),
      start_known_(is_start_known(settings, begun_)),
      session_(session.value_or(session_of_seed(settings.get<RunSettings>().seed))),
      law_(law ? std::move(law) : make_law(settings)),
      guard_({.earliest = earliest_stamp(settings)}),
      odometry_guard_({.earliest = earliest_stamp(settings)}),
      counters_(loop, bus, "controller", channels_.control_counters,
                from_seconds(settings.get<RunSettings>().report_period_s),
                [this](CounterList& out) { list_counters(out); }) {
  if (config_.send == ControllerSettings::Send::changed) sending_.emplace(config_);
  subscribe_in_run<pose_t>(
      bus, loop, channels_.control_pose, 1, rejected_, [this](const pose_t& m) {
        SeenPose seen;
        seen.pose = {m.x_m, m.y_m, m.yaw_rad};
        seen.stamp = from_utime(m.utime);
        seen.arrival = loop_.now();
        seen.seq = m.seq;
        if (m.plan_session == session_ && m.plan_id >= 0) seen.plan_id = m.plan_id;
        seen.follows_other = m.plan_session >= 0 && m.plan_session != session_ && m.plan_id >= 0;
        on_pose(seen);
      });
  subscribe<odometry_t>(bus, channels_.control_odometry, kDeepQueue, undecodable_odometry_,
                        [this](const odometry_t& m) { on_odometry(m); });
  if (settings.get<AutonomySettings>().enabled) {
    reports_.emplace(earliest_stamp(settings));
    subscribe_in_run<autonomy_state_t>(bus, loop, channels_.control_autonomy, kDeepQueue,
                                       reports_->rejected,
                                       [this](const autonomy_state_t& m) { on_autonomy(m); });
  }
  if (config_.preload && law_->plans_ahead()) {
    // This priority comes before the first pose of that instant is measured, so that the pose names
    // the plan.
    loop.at(kStart - from_seconds(settings.get<RunSettings>().lead_s), Priority::physics,
            [this](Instant) {
              const std::optional<Plan> plan = law_->preload();
              if (plan) send_plan(loop_.now(), *plan, channels_.control_preload);
            });
  }
  if (config_.trigger == ControllerSettings::Trigger::event && pose_timeout_ > Duration{0}) {
    loop.at(begun_ + pose_timeout_, Priority::node, [this](Instant) {
      if (!newest_) on_possible_timeout();
    });
  }
  if (config_.trigger == ControllerSettings::Trigger::timer) {
    const Duration period = from_seconds(1.0 / config_.rate_hz);
    loop.every(first_tick(from_seconds(settings.get<RunSettings>().lead_s), period) +
                   settings.get<FleetSettings>().tick_delay(period),
               period, Priority::node, [this](Instant) { decide(); });
  }
}

void ControllerNode::on_pose(const SeenPose& seen) {
  if (!is_usable(seen.pose)) {
    ++non_finite_;
    return;
  }
  if (!guard_.accept(seen.arrival, seen.stamp, seen.seq)) return;
  newest_ = seen;
  law_->on_pose(seen);
  if (config_.trigger == ControllerSettings::Trigger::timer) return;
  decide();
  if (pose_timeout_ > Duration{0} && !timed_out(loop_.now())) {
    loop_.at(seen.stamp + pose_timeout_, Priority::node,
             [this](Instant) { on_possible_timeout(); });
  }
}

void ControllerNode::on_odometry(const odometry_t& m) {
  any_odometry_ = true;
  SeenOdometry seen;
  seen.reckoning = {{m.x_m, m.y_m, m.yaw_rad},
                    {m.cov_x_x_m2, m.cov_x_y_m2, m.cov_x_yaw_m_rad, m.cov_y_y_m2, m.cov_y_yaw_m_rad,
                     m.cov_yaw_yaw_rad2},
                    m.distance_m};
  seen.twist = {m.v_mps, m.omega_radps};
  seen.stamp = from_utime(m.utime);
  seen.arrival = loop_.now();
  seen.seq = m.seq;
  const PoseCovariance& p = seen.reckoning.covariance;
  const bool usable = is_usable(seen.reckoning.pose) && is_usable(seen.twist) &&
                      is_usable(m.distance_m) && is_usable(p.x_x) && is_usable(p.x_y) &&
                      is_usable(p.x_yaw) && is_usable(p.y_y) && is_usable(p.y_yaw) &&
                      is_usable(p.yaw_yaw);
  if (!usable) {
    ++non_finite_odometry_;
  } else if (odometry_guard_.accept(seen.arrival, seen.stamp, seen.seq)) {
    law_->on_odometry(seen);
  }
}

void ControllerNode::on_autonomy(const autonomy_state_t& m) {
  SeenAutonomy seen;
  seen.driven = m.state == autonomy_state_t::REMOTE;
  seen.asks = seen.driven || m.state == autonomy_state_t::REMOTE_REQUESTED;
  seen.handover = m.handover;
  seen.path_s_m = m.path_s_m;
  seen.stamp = from_utime(m.utime);
  seen.arrival = loop_.now();
  constexpr double kLongestPath_m = 1e5;
  bool usable = m.path_s_m >= 0.0 && m.path_s_m <= kLongestPath_m;
  for (std::size_t i = 0; i < m.obstacle_x_m.size(); ++i) {
    seen.obstacles.push_back({m.obstacle_x_m[i], m.obstacle_y_m[i]});
    usable = usable && is_usable(m.obstacle_x_m[i]) && is_usable(m.obstacle_y_m[i]);
  }
  if (!usable) {
    ++reports_->non_finite;
  } else if (reports_->guard.accept(seen.arrival, seen.stamp, m.seq)) {
    reports_->asked = seen.asks ? std::optional(seen.stamp) : std::nullopt;
    law_->on_autonomy(seen);
  }
}

std::int64_t ControllerNode::pose_utime() const {
  if (reports_) return reports_->asked ? to_utime(*reports_->asked) : -1;
  return newest_ ? to_utime(newest_->stamp) : -1;
}

void ControllerNode::on_possible_timeout() {
  // A newer pose may have come since this was scheduled.
  if (timed_out(loop_.now())) decide();
}

bool ControllerNode::timed_out(Instant now) const {
  return pose_timeout_ > Duration{0} && now - (newest_ ? newest_->stamp : begun_) >= pose_timeout_;
}

void ControllerNode::decide() {
  const Instant now = loop_.now();
  if (timed_out(now) && now >= kStart) {
    ++pose_timeouts_;
    send(now, law_->stop(now), true);
  } else if (law_->plans_ahead() ? newest_ || start_known_ : newest_ && now >= kStart) {
    if (ask_) {
      ask_();
    } else {
      decide_by_law();
    }
  } else if (law_->plans_ahead()) {
    send(now, law_->stop(now), false);
  } else {
    send(now, Twist{}, false);
  }
}

void ControllerNode::decide_by_law(bool sends) {
  const Instant now = loop_.now();
  LawOutput decision = law_->decide(now, newest());
  if (!is_usable(decision)) {  // by no known input; NaN must neither go out nor stay in the law
    ++unusable_commands_;
    decision = law_->stop(now);
  }
  send(now, decision, false, sends);
}

void ControllerNode::send(Instant now, const LawOutput& decision, bool stopped, bool sends) {
  const auto* plan = std::get_if<Plan>(&decision);
  const Twist twist = plan == nullptr ? std::get<Twist>(decision) : plan->twists.front();
  if (sends && (!sending_ || sending_->is_due(now, decision, stopped, newest()))) {
    if (plan == nullptr) {
      send_twist(now, twist);
    } else {
      send_plan(now, *plan, channels_.control_plan);
    }
    ++sent_;
    last_sent_ = {now, twist};
  }

  const LawErrors errors = law_->errors();
  controller_report_t report{};
  report.utime = to_utime(now);
  report.seq = decisions_++;
  report.pose_utime = pose_utime();
  report.pose_seq = newest_ ? newest_->seq : -1;
  report.pose_age_s = newest_ ? to_seconds(now - newest_->stamp) : 0.0;
  report.heading_error_rad = errors.heading_rad;
  report.distance_error_m = errors.distance_m;
  report.v_mps = twist.v_mps;
  report.omega_radps = twist.omega_radps;
  report.pose_timed_out = stopped ? 1 : 0;
  publish(bus_, channels_.control_report, report);
}

void ControllerNode::send_twist(Instant now, const Twist& twist) {
  twist_t command{};
  command.utime = to_utime(now);
  command.seq = sent_;
  command.run = loop_.run_id();
  command.pose_utime = pose_utime();
  command.v_mps = twist.v_mps;
  command.omega_radps = twist.omega_radps;
  publish(bus_, channels_.control_command, command);
}

void ControllerNode::send_plan(Instant now, const Plan& plan, const std::string& channel) {
  plan_t message{};
  message.utime = to_utime(now);
  message.seq = sent_;
  message.run = loop_.run_id();
  message.session = session_;
  message.id = plan.name.id;
  message.based_on = plan.based_on;
  message.based_on_last = plan.based_on_last;
  message.pose_utime = pose_utime();
  message.start_utime = to_utime(plan.start);
  message.settled_utime = to_utime(plan.settled);
  message.step_us = static_cast<std::int32_t>(plan.step / std::chrono::microseconds{1});
  message.count = static_cast<std::int32_t>(plan.twists.size());
  message.v_mps.reserve(plan.twists.size());
  message.omega_radps.reserve(plan.twists.size());
  for (const Twist& twist : plan.twists) {
    message.v_mps.push_back(static_cast<float>(twist.v_mps));
    message.omega_radps.push_back(static_cast<float>(twist.omega_radps));
  }
  publish(bus_, channel, message);
}

void ControllerNode::finish() { counters_.publish_now(); }

void ControllerNode::list_counters(CounterList& out) const {
  guard_.list("pose", out);
  rejected_.list("pose", out);
  senders_.list(out);
  out.emplace_back("pose.non_finite", non_finite_);
  out.emplace_back("pose.timeouts", pose_timeouts_);
  if (any_odometry_ || undecodable_odometry_ > 0) {
    odometry_guard_.list("odometry", out);
    out.emplace_back("odometry.undecodable", undecodable_odometry_);
    out.emplace_back("odometry.non_finite", non_finite_odometry_);
  }
  if (reports_) {
    reports_->guard.list("autonomy", out);
    reports_->rejected.list("autonomy", out);
    out.emplace_back("autonomy.non_finite", reports_->non_finite);
  }
  out.emplace_back("command.unusable", unusable_commands_);
  if (sending_) out.emplace_back("command.decided", decisions_);
  out.emplace_back("command.sent", sent_);
  law_->list_counters(out);
}

}  // namespace tether
