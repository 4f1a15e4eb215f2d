#include "can_bridge/node/can_bridge_node.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <tether/plan_in_force_t.hpp>
#include <tether/wheel_feedback_t.hpp>
#include <utility>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "common/base/errors.hpp"
#include "common/base/say.hpp"
#include "common/node/message_io.hpp"
#include "common/program/service_manager.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/actuator_policy.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/odometry_message.hpp"
#include "common/vehicle/plan.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

AutonomyWatch::AutonomyWatch(
    const Sections<RunSettings, VehicleSettings, CanSettings, AutonomySettings>& settings,
    EventLoop& loop, Bus& bus)
    : stopping_(settings.get<AutonomySettings>()),
      max_speed_mps_(settings.get<CanSettings>().max_speed_mps),
      guard_({.earliest = earliest_stamp(settings)}) {
  subscribe_in_run<autonomy_state_t>(
      bus, loop, ChannelNames(settings.get<VehicleSettings>().name).vehicle_autonomy, kDeepQueue,
      rejected_, [this, &loop](const autonomy_state_t& m) {
        if (!guard_.accept(loop.now(), from_utime(m.utime), m.seq)) return;
        heard_ = loop.now();
        clear_m_ = is_usable(m.clear_m) ? m.clear_m : 0.0;
      });
}

void AutonomyWatch::demand(Instant now, double speed_mps, SafetyDemands& all) const {
  std::string why;
  if (!heard_) {
    why = "autonomy: not heard yet";
  } else if (now - *heard_ > kFresh) {
    why = fmt::format("autonomy: silent for {:.0f} ms", std::floor(to_milliseconds(now - *heard_)));
  } else if (stopping_.length_m(speed_mps) > clear_m_ + kBeyond_m && std::abs(speed_mps) > 0.0) {
    why = fmt::format("autonomy: {:.2f} m free, {:.2f} m needed to stop", clear_m_,
                      stopping_.length_m(speed_mps));
  }
  if (!why.empty()) {
    // A demand that an input has made already says whether it ramps and resumes.
    if (all.stop.empty()) all.ramp = all.may_resume = true;
    all.stop += (all.stop.empty() ? "" : "; ") + why;
    return;
  }
  const double allowed_mps = stopping_.allowed_mps(clear_m_);
  if (all.speed_limit_mps.value_or(max_speed_mps_) <= allowed_mps) return;
  all.speed_limit_mps = allowed_mps;
  all.speed_limit_by = "autonomy";
}

void AutonomyWatch::list(CounterList& out) const {
  guard_.list("autonomy", out);
  rejected_.list("autonomy", out);
}

namespace {

/// For an adapter that answers no command, slcan's driver waits 1 s each. tether-can-links'
/// watchdog ends a change, down or up, after 10 s.
constexpr Duration kLongestRestart = std::chrono::seconds{20};

static_assert(static_cast<int>(BridgeState::starting) == drivetrain_state_t::STARTING);
static_assert(static_cast<int>(BridgeState::refused) == drivetrain_state_t::REFUSED);
static_assert(static_cast<int>(BridgeState::disarmed) == drivetrain_state_t::DISARMED);
static_assert(static_cast<int>(BridgeState::arming) == drivetrain_state_t::ARMING);
static_assert(static_cast<int>(BridgeState::armed) == drivetrain_state_t::ARMED);
static_assert(static_cast<int>(BridgeState::stopping) == drivetrain_state_t::STOPPING);
static_assert(static_cast<int>(BridgeState::fault) == drivetrain_state_t::FAULT);
static_assert(static_cast<int>(BridgeState::estop) == drivetrain_state_t::ESTOP);
static_assert(static_cast<int>(BridgeState::unconfirmed) == drivetrain_state_t::UNCONFIRMED);
static_assert(static_cast<int>(DriveRequest::arm) == drive_request_t::ARM);
static_assert(static_cast<int>(DriveRequest::disarm) == drive_request_t::DISARM);
static_assert(static_cast<int>(DriveRequest::estop) == drive_request_t::ESTOP);
static_assert(static_cast<int>(DriveRequest::estop_release) == drive_request_t::ESTOP_RELEASE);
static_assert(static_cast<int>(DriveRequest::reset) == drive_request_t::RESET);
static_assert(static_cast<int>(DriveRequest::alive) == drive_request_t::ALIVE);

Instant beginning(const BridgeSettings& settings) {
  return kStart - from_seconds(settings.get<RunSettings>().lead_s);
}

SafetyCore::Config safety_config(const BridgeSettings& settings, const DrivetrainConfig& config) {
  const auto& can = settings.get<CanSettings>();
  return {from_seconds(can.stale_ms * 1e-3),
          from_seconds(can.disarm_ms * 1e-3),
          can.max_stale_m,
          from_seconds(can.max_blind_s),
          can.max_blind_m,
          from_seconds(can.operator_timeout_ms * 1e-3),
          twist_limits(settings),
          beginning(settings),
          settings.get<VehicleSettings>().wheel_radius_m,
          settings.get<ActuatorSettings>(),
          settings.get<VehicleSettings>(),
          own_stop(config, settings.get<VehicleSettings>().wheel_radius_m)};
}

std::vector<CanFilter> all_filters(const DriveProfile& profile, const SafetyInputs& inputs) {
  std::vector<CanFilter> filters = profile.filters();
  for (const CanFilter& wanted : inputs.filters()) {
    for (const CanFilter& own : profile.filters()) {
      if (own.extended || ((wanted.id ^ own.id) & own.mask) != 0) continue;
      throw UsageError(fmt::format(
          "safety_input.id = 0x{:03X} is a frame of the drivetrain itself: give it another one",
          wanted.id));
    }
    filters.push_back(wanted);
  }
  return filters;
}

/// A wheel that is pushed may exceed the limits of commands; reports of more than twice are wrong.
double most_rim_speed_mps(const TwistLimits& limits) {
  const double turning_mps = limits.max_yaw_rate_radps * limits.track_m / 2.0;
  const double fastest_mps = std::max(limits.max_speed_mps, limits.max_reverse_mps) + turning_mps;
  return 2.0 * std::min(fastest_mps, limits.max_wheel_speed_mps);
}

/// The vehicle's speed by the faster witness of each wheel.
double vehicle_speed_mps(const DrivetrainSnapshot& drives, double wheel_radius_m) {
  return (drives.wheels[0].fastest_radps + drives.wheels[1].fastest_radps) / 2.0 * wheel_radius_m;
}

double age_s(const WheelFeedback& wheel, Instant now) {
  return wheel.valid ? to_seconds(now - wheel.stamp) : -1.0;
}

}  // namespace

CanBridgeNode::CanBridgeNode(const BridgeSettings& settings, const DrivetrainConfig& config,
                             EventLoop& loop, Bus& bus, CanPort& port)
    : CanBridgeNode(settings, config, loop, bus, port,
                    make_drive_profile(config, settings.get<VehicleSettings>())) {}

CanBridgeNode::CanBridgeNode(const BridgeSettings& settings, const DrivetrainConfig& config,
                             EventLoop& loop, Bus& bus, CanPort& port,
                             std::unique_ptr<DriveProfile> profile, const GpioOpener& open_gpio)
    : loop_(loop),
      bus_(bus),
      port_(port),
      channels_(settings.get<VehicleSettings>().name),
      senders_(loop, bus,
               settings.get<AutonomySettings>().enabled
                   ? std::vector<std::string>{channels_.vehicle_drive}
                   : std::vector<std::string>{channels_.vehicle_command, channels_.vehicle_plan}),
      profile_(std::move(profile)),
      safety_(safety_config(settings, config)),
      inputs_(safety_inputs(config)),
      gpio_(safety_inputs(config), loop, inputs_, open_gpio),
      whitelist_(transmit_rules(config)),
      odometry_(settings.get<VehicleSettings>()),
      cycle_(from_seconds(settings.get<CanSettings>().cycle_ms * 1e-3)),
      wheel_radius_m_(settings.get<VehicleSettings>().wheel_radius_m),
      takes_plans_(kind_of(settings.get<ActuatorSettings>()).takes_plans),
      counters_(loop, bus, "can_bridge", channels_.can_counters,
                from_seconds(settings.get<RunSettings>().report_period_s),
                [this](CounterList& out) { list_counters(out); }) {
  const auto& can = settings.get<CanSettings>();
  check_cycle(config, can.cycle_ms);
  check_deceleration(config, can.max_deceleration_mps2, wheel_radius_m_);
  profile_->require_deceleration(can.max_deceleration_mps2);
  profile_->limit_reports(most_rim_speed_mps(twist_limits(settings)));
  if (const std::string warning = port.warning(); !warning.empty()) {
    say(Severity::warning, "tether-can-bridge: warning: " + warning);
  }
  const bool drives_itself = settings.get<AutonomySettings>().enabled;
  if (drives_itself) autonomy_.emplace(settings, loop, bus);
  subscribe_in_run<twist_t>(
      bus, loop, drives_itself ? channels_.vehicle_drive : channels_.vehicle_command, kDeepQueue,
      rejected_commands_, [this](const twist_t& m) { on_command(m); });
  if (!drives_itself)
    subscribe_to_plans(bus, loop, channels_, rejected_plans_, [this](PlanSource source, Plan plan) {
      safety_.on_plan(loop_.now(), source, std::move(plan));
    });
  subscribe<drive_request_t>(bus, channels_.can_request, kDeepQueue, rejected_requests_.undecodable,
                             [this](const drive_request_t& m) { on_request(m); });
  port.on_frame(all_filters(*profile_, inputs_),
                [this](const CanFrame& frame) { on_frame(frame); });
  port.on_state([this](CanState state) { safety_.on_bus_state(state); });
  loop.every(beginning(settings), cycle_, Priority::node,
             [this](Instant scheduled) { on_cycle(scheduled); });
}

void CanBridgeNode::on_command(const twist_t& message) {
  safety_.on_command(loop_.now(), from_utime(message.utime), message.seq,
                     {message.v_mps, message.omega_radps}, pose_time(message.pose_utime));
}

void CanBridgeNode::on_request(const drive_request_t& message) {
  // A request to stop acts whatever run it is of.
  const bool stops =
      message.request == drive_request_t::ESTOP || message.request == drive_request_t::DISARM;
  if (message.run != loop_.run_id() && !stops) {
    ++rejected_requests_.other_run;
    return;
  }
  safety_.on_request(loop_.now(), from_utime(message.utime), message.seq, message.request);
}

void CanBridgeNode::on_frame(const CanFrame& frame) {
  if (inputs_.on_frame(frame, loop_.now())) return;
  if (!started_) return;
  if (guard_) guard_->on_frame(frame);
  profile_->on_frame(frame, loop_.now());
}

void CanBridgeNode::on_cycle(Instant scheduled) {
  const Instant now = loop_.now();
  if (left_) return;
  if (now - scheduled >= cycle_) {  // the next one is due already
    ++cycle_slips_;
    return;
  }
  if (!started_) profile_->start(now);
  started_ = true;

  safety_.on_senders(senders_.trouble());
  gpio_.read();
  const DrivetrainSnapshot drives = profile_->snapshot(now);
  SafetyDemands demands = inputs_.cycle(now);
  if (autonomy_) autonomy_->demand(now, vehicle_speed_mps(drives, wheel_radius_m_), demands);
  if (estop_file_) demands.no_release = estop_file_->trouble();
  if (guard_) demands.no_arming = guard_->refusal();
  safety_.on_safety_inputs(std::move(demands));
  odometry_.update(drives.wheels);
  const Decision decision = safety_.cycle(now, drives, port_.state(), odometry_.state().distance_m);
  act(decision, now);

  publish_state(decision, now);
  publish_wheels(drives, now);
  publish_odometry(now);
  if (takes_plans_) publish_plan(now);
  estop_latched_ = decision.estop_latched;
  if (estop_file_) estop_file_->remember(decision.estop_latched, loop_.now());
  ++cycles_;
}

void CanBridgeNode::act(const Decision& decision, Instant now) {
  if (decision.distrust_until) profile_->distrust_standstill(*decision.distrust_until);
  switch (decision.action) {
    case Decision::Action::none:
      break;
    case Decision::Action::enable:
      profile_->enable();
      break;
    case Decision::Action::quick_stop:
      profile_->stop(StopKind::quick);
      break;
    case Decision::Action::disable:
      profile_->stop(StopKind::disable);
      break;
    case Decision::Action::reset_fault:
      profile_->reset_fault();
      break;
    case Decision::Action::restart_bus: {
      std::string why;
      const LongCall waits_for_the_adapter{kLongestRestart};
      const bool done = port_.restart(why);
      safety_.on_bus_restarted(done, why);
      break;
    }
  }
  profile_->set_command(decision.twist);
  frames_.clear();
  profile_->tick(now, frames_);
  if (guard_) guard_->tick(now, profile_->snapshot(now).phase, frames_);
  for (CanFrame& frame : frames_) {
    // The process was suspended or starved since the decision, so that the rest of its frames is
    // outdated.
    if (loop_.now() - now >= cycle_) {
      ++late_frames_;
    } else if (whitelist_.pass(frame, decision.may_move)) {
      port_.send(frame);
    }
  }
}

void CanBridgeNode::publish_state(const Decision& decision, Instant now) {
  drivetrain_state_t message{};
  message.utime = to_utime(now);
  message.seq = cycles_;
  message.run = loop_.run_id();
  message.state = static_cast<std::int32_t>(decision.state);
  message.state_name = to_string(decision.state);
  message.reason = decision.reason;
  if (const std::string intruder = profile_->intruder(); !intruder.empty()) {
    if (!message.reason.empty()) message.reason += "; ";
    message.reason += "another sender commands these drives: " + intruder;
  }
  if (const std::string warnings = profile_->warnings(); !warnings.empty()) {
    if (!message.reason.empty()) message.reason += "; ";
    message.reason += "warned since the last reset: " + warnings;
  }
  message.bus = to_string(port_.state());
  const auto age = safety_.command_age(now);
  message.command_age_s = age ? to_seconds(*age) : -1.0;
  message.v_mps = decision.twist.v_mps;
  message.omega_radps = decision.twist.omega_radps;
  message.disarms = safety_.disarms();
  publish(bus_, channels_.can_state, message);
}

void CanBridgeNode::publish_wheels(const DrivetrainSnapshot& drives, Instant now) {
  const auto& [left, right] = drives.wheels;
  wheel_feedback_t message{};
  message.utime = to_utime(now);
  message.seq = cycles_;
  message.fresh = drives.feedback_fresh ? 1 : 0;
  message.left_age_s = age_s(left, now);
  message.right_age_s = age_s(right, now);
  message.left_angle_rad = left.angle_rad;
  message.right_angle_rad = right.angle_rad;
  message.left_rim_mps = left.speed_radps * wheel_radius_m_;
  message.right_rim_mps = right.speed_radps * wheel_radius_m_;
  message.left_position_counts = left.position_counts;
  message.right_position_counts = right.position_counts;
  message.left_statusword = static_cast<std::int32_t>(left.statusword);
  message.right_statusword = static_cast<std::int32_t>(right.statusword);
  message.left_error_code = static_cast<std::int32_t>(left.error_code);
  message.right_error_code = static_cast<std::int32_t>(right.error_code);
  message.left_state = left.state;
  message.right_state = right.state;
  publish(bus_, channels_.can_wheels, message);
}

void CanBridgeNode::publish_odometry(Instant now) {
  const Odometry::State& state = odometry_.state();
  publish(bus_, channels_.can_odometry, odometry_message(now, cycles_, state, state.twist));
}

void CanBridgeNode::publish_plan(Instant now) {
  const PlanName plan = safety_.plan();
  plan_in_force_t message{};
  message.utime = to_utime(now);
  message.seq = cycles_;
  message.session = plan.session;
  message.id = plan.id;
  publish(bus_, channels_.can_plan, message);
}

void CanBridgeNode::use_estop_file(EstopFile file) {
  if (file.latched()) safety_.restore_estop(file.why());
  estop_file_ = std::move(file);
}

bool CanBridgeNode::wind_down() {
  const Instant now = loop_.now();
  safety_.leave(now);
  const bool had_left = std::exchange(left_, safety_.has_left(now));
  if (left_ && !had_left && estop_file_ && safety_.left_behind().empty()) estop_file_->end();
  return left_;
}

void CanBridgeNode::finish() {
  counters_.publish_now();
  if (const std::string left = safety_.left_behind(); !left.empty()) throw std::runtime_error(left);
}

void CanBridgeNode::list_counters(CounterList& out) const {
  safety_.list(out);
  inputs_.list(out);
  if (autonomy_) autonomy_->list(out);
  rejected_commands_.list("command", out);
  if (takes_plans_) rejected_plans_.list("plan", out);
  rejected_requests_.list("request", out);
  senders_.list(out);
  port_.list(out);
  const DriveProfile::Counters drive = profile_->counters();
  out.emplace_back("drive.rejected_frames", drive.rejected_frames);
  out.emplace_back("drive.intruder_frames", drive.intruder_frames);
  // Lists counters that only some drives have, unless they are zero.
  const auto list_if_any = [&out](const char* name, std::int64_t count) {
    if (count > 0) out.emplace_back(name, count);
  };
  list_if_any("drive.intruder_writes", drive.intruder_writes);
  list_if_any("drive.stops_by_sdo", drive.stops_by_sdo);
  list_if_any("drive.heartbeat_withheld", drive.heartbeat_withheld);
  list_if_any("drive.brake_escalations", drive.brake_escalations);
  list_if_any("drive.warnings", drive.warnings);
  list_if_any("drive.surplus_feedback", drive.surplus_feedback);
  out.emplace_back("tx.denied", whitelist_.counters().denied);
  out.emplace_back("tx.zeroed", whitelist_.counters().zeroed);
  out.emplace_back("tx.late", late_frames_);
  out.emplace_back("odometry.gaps", odometry_.gaps());
  out.emplace_back("odometry.reanchored", odometry_.reanchored());
  out.emplace_back("cycle.slips", cycle_slips_);
}

}  // namespace tether
