#include "sim/node/sim_node.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <tether/clock_t.hpp>
#include <tether/ground_truth_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/twist_t.hpp>
#include <tether/wheel_states_t.hpp>
#include <tether/wheel_targets_t.hpp>
#include <utility>

#include "common/node/channel_names.hpp"
#include "common/node/message_io.hpp"
#include "common/node/timer_queue.hpp"
#include "common/path/controlled_point.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/odometry_message.hpp"
#include "common/vehicle/plan.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/scan.hpp"
#include "sim/plant/true_start.hpp"
#include "sim/sensor/sensor_settings.hpp"

namespace tether {

Scanning::Scanning(const ScanSettings& settings, EventLoop& loop, Bus& bus)
    : loop_(loop),
      bus_(bus),
      channels_(settings.get<VehicleSettings>().name),
      lidar_(settings.get<LidarSettings>()),
      clock_offset_(from_seconds(settings.get<VehicleSettings>().clock_offset_ms * 1e-3)),
      moving_(settings, settings.get<RunSettings>().seed),
      model_(lidar_, settings.get<VehicleSettings>(), standing_shapes(settings),
             settings.get<RunSettings>().seed, settings.get<VehicleSettings>().name),
      in_parts_(settings.get<LocaliserSettings>().place == LocaliserSettings::Place::edge),
      part_bytes_(static_cast<std::size_t>(settings.get<LocaliserSettings>().part_bytes)) {}

void Scanning::publish_turn(Instant end, PlanName plan, std::vector<Shape> others) {
  const Instant begin = end - sweep();
  for (Shape& shape : others) {  // to where it was at the begin
    shape.pose.x_m -= shape.vx_mps * to_seconds(sweep());
    shape.pose.y_m -= shape.vy_mps * to_seconds(sweep());
  }
  const std::vector<Shape>& moving = moving_.at(to_seconds(begin));
  others.insert(others.end(), moving.begin(), moving.end());
  Scan scan = model_.turn(begin, track_, others);
  track_.forget_before(end);
  scan.plan = plan;
  scan.stamp += clock_offset_;
  publish(bus_, channels_.vehicle_scan, scan_message(scan, loop_.run_id()));
  if (!in_parts_) return;
  const double step_m = std::max({lidar_.range_step_m, lidar_.range_max_m / kMostRangeSteps, 1e-3});
  for (const scan_part_t& part : scan_parts(scan, loop_.run_id(), part_seq_, part_bytes_, step_m)) {
    publish(bus_, channels_.vehicle_scan_part, part);
    ++part_seq_;
  }
}

WheelCoupling::WheelCoupling(const Sections<RunSettings, VehicleSettings>& settings,
                             EventLoop& loop, Bus& bus, const Plant& vehicle)
    : loop_(loop),
      bus_(bus),
      vehicle_(vehicle),
      wheel_radius_m_(settings.get<VehicleSettings>().wheel_radius_m),
      guard_({.earliest = kStart - from_seconds(settings.get<RunSettings>().lead_s)}) {
  const ChannelNames channels(settings.get<VehicleSettings>().name);
  states_channel_ = channels.wheel_states;
  subscribe<wheel_targets_t>(
      bus, channels.wheel_targets, kDeepQueue, undecodable_, [this](const wheel_targets_t& m) {
        if (!is_usable(m.left_speed_radps) || !is_usable(m.right_speed_radps)) {
          ++non_finite_;
          return;
        }
        if (!guard_.accept(loop_.now(), from_utime(m.utime), m.seq)) return;
        targets_ = {m.left_speed_radps * wheel_radius_m_, m.right_speed_radps * wheel_radius_m_};
        arrival_ = loop_.now();
        any_ = true;
      });
}

WheelSpeeds WheelCoupling::in_force(Instant now) const {
  return any_ && now - arrival_ < kTimeout ? targets_ : WheelSpeeds{};
}

void WheelCoupling::publish_wheels(Instant now) {
  const VehicleState s = vehicle_.state();
  wheel_states_t message{};
  message.utime = to_utime(now);
  message.seq = seq_++;
  message.left_angle_rad = s.left_wheel_angle_rad;
  message.right_angle_rad = s.right_wheel_angle_rad;
  message.left_speed_radps = s.rim_speeds.left_mps / wheel_radius_m_;
  message.right_speed_radps = s.rim_speeds.right_mps / wheel_radius_m_;
  publish(bus_, states_channel_, message);
}

void WheelCoupling::list(CounterList& out) const {
  guard_.list("wheel_targets", out);
  out.emplace_back("wheel_targets.undecodable", undecodable_);
  out.emplace_back("wheel_targets.non_finite", non_finite_);
}

namespace {

constexpr Duration kClockPeriod = std::chrono::milliseconds{50};
/// In real time the world moves at least this often, because waking up for each step costs more
/// than the step itself. Whatever looks at the world in between first moves it up to that time.
constexpr Duration kRealTimeBatch = std::chrono::milliseconds{5};
/// The error is measured only this often, because computing the reference costs more than a step of
/// the kinematic plant and 1 or 2 % of one of ODE. ε is then off by less than 1 µm
/// (docs/explanation/physics.md).
constexpr Duration kMetricsPeriod = std::chrono::milliseconds{10};

/// How often the vehicle reads its encoders, whatever rate its odometry is sent at.
constexpr Duration kEncoderPeriod = std::chrono::milliseconds{10};

Metrics::Settings metrics_of(const RunSettings& run) {
  return {run.settled_from_s, run.lost_beyond_m, run.lost_for_s};
}

/// Actuator settings; the drives of a vehicle that decides itself accept only fresh twists.
ActuatorSettings actuator_of(const SimSettings& settings) {
  ActuatorSettings actuator = settings.get<ActuatorSettings>();
  if (settings.get<AutonomySettings>().enabled) {
    actuator.policy = "zero";
    actuator.timeout_s = to_seconds(SimNode::kDriveTimeout);
  }
  return actuator;
}

std::vector<std::string> senders_to(const ChannelNames& channels, const SimSettings& settings) {
  std::vector<std::string> heard{channels.vehicle_command, channels.vehicle_plan, channels.can_plan,
                                 channels.wheel_targets};
  if (settings.get<AutonomySettings>().enabled) heard.push_back(channels.vehicle_drive);
  return heard;
}

}  // namespace

SimNode::SimNode(const SimSettings& settings, EventLoop& loop, Bus& bus, Traffic* traffic)
    : loop_(loop),
      bus_(bus),
      step_(step_of(settings.get<WorldSettings>())),
      end_(kStart + from_seconds(settings.get<RunSettings>().duration_s)),
      world_end_(end_),
      next_step_(TimerQueue::not_before(loop.now(), kStart + step_, step_)),
      world_time_(std::max(kStart, next_step_ - step_)),
      metrics_step_(std::max(kMetricsPeriod, step_)),
      vehicle_(
          make_plant(at_true_start(settings.get<VehicleSettings>(),
                                   random_stream(settings.get<RunSettings>().seed,
                                                 settings.get<VehicleSettings>().name + "/start")),
                     settings.get<WorldSettings>(), step_, settings.get<RunSettings>().seed,
                     settings.get<Surroundings>())),
      path_(make_path(settings.get<PathSettings>())),
      point_ahead_m_(
          controlled_point_ahead_m(settings.get<PathSettings>(), settings.get<VehicleSettings>())),
      drive_errors_(settings.get<VehicleSettings>()),
      metrics_(metrics_of(settings.get<RunSettings>())),
      actuator_(actuator_of(settings), settings.get<VehicleSettings>(),
                {.earliest = earliest_stamp(settings)}),
      channels_(settings.get<VehicleSettings>().name),
      senders_(loop, bus, senders_to(channels_, settings)),
      sensor_latency_(from_seconds(settings.get<SensorSettings>().latency_ms * 1e-3)),
      clock_offset_(from_seconds(settings.get<VehicleSettings>().clock_offset_ms * 1e-3)),
      sensor_(settings.get<SensorSettings>(), settings.get<RunSettings>().seed,
              settings.get<VehicleSettings>().name),
      guard_({.earliest = earliest_stamp(settings)}),
      counters_(loop, bus, "sim", channels_.sim_counters,
                from_seconds(settings.get<RunSettings>().report_period_s),
                [this](CounterList& out) {
                  advance(loop_.now());
                  list_counters(out);
                }) {
  metrics_.start(error_m(), to_seconds(world_time_));
  if (traffic != nullptr) join(*traffic, settings.get<VehicleSettings>());
  // In virtual time, looking at the world moves it.
  if (loop.rate() > 0.0) {
    loop.every(kStart + kRealTimeBatch, kRealTimeBatch, Priority::physics,
               [this](Instant now) { advance(now); });
  }
  if (settings.get<VehicleSettings>().drivetrain == VehicleSettings::Drivetrain::can) {
    world_end_ = Instant::max();
    drives_ = std::make_unique<WheelCoupling>(settings, loop, bus, *vehicle_);
    if (actuator_.takes_plans()) plan_watch_ = std::make_unique<PlanWatch>(settings, loop, bus);
    const Duration coupling = from_seconds(settings.get<VehicleSettings>().coupling_ms * 1e-3);
    loop.every(first_tick(from_seconds(settings.get<RunSettings>().lead_s), coupling), coupling,
               Priority::physics, [this](Instant now) {
                 advance(now);
                 drives_->publish_wheels(now);
               });
  } else {
    subscribe_to_commands(settings.get<AutonomySettings>().enabled);
  }
  start_sensors(settings);
  may_be_equal_ = !drives_ && !drive_errors_.lags() && !scanning_ && !odometry_;
  const Duration lead = from_seconds(settings.get<RunSettings>().lead_s);
  if (settings.get<FleetSettings>().number == 1) {
    loop.every(first_tick(lead, kClockPeriod), kClockPeriod, Priority::observer,
               [this](Instant now) { publish_clock(now); });
  }
  loop.every(kStart, from_seconds(1.0 / settings.get<RunSettings>().truth_rate_hz),
             Priority::observer, [this](Instant now) {
               advance(now);
               publish_truth();
             });
}

void SimNode::join(Traffic& traffic, const VehicleSettings& vehicle) {
  traffic_ = &traffic;
  number_in_traffic_ = traffic.add(vehicle, *vehicle_, [this](Instant t) { make_steps(t); });
}

void SimNode::start_sensors(const SimSettings& settings) {
  const Duration lead = from_seconds(settings.get<RunSettings>().lead_s);
  const auto& sensor = settings.get<SensorSettings>();
  const auto& fleet = settings.get<FleetSettings>();
  if (sensor.send == SensorSettings::Send::changed)
    pose_sending_ = std::make_unique<PoseSending>(sensor);
  if (settings.get<LocaliserSettings>().place == LocaliserSettings::Place::none) {
    const Duration period = from_seconds(1.0 / sensor.rate_hz);
    loop_.every(first_tick(lead, period) + fleet.tick_delay(period), period, Priority::node,
                [this](Instant now) { sample_pose(now); });
  }
  if (sensor.odometry_rate_hz > 0.0) {
    odometry_ =
        std::make_unique<WheelOdometry>(settings.get<VehicleSettings>(), sensor.encoder_ticks);
    const Duration period = from_seconds(1.0 / sensor.odometry_rate_hz);
    loop_.every(first_tick(lead, period) + fleet.tick_delay(period), period, Priority::node,
                [this](Instant now) { publish_odometry(now); });
  }
  if (!settings.get<LidarSettings>().on()) return;
  scanning_ = std::make_unique<Scanning>(settings, loop_, bus_);
  scanning_->record(world_time_, vehicle_->state().pose);
  const Duration turn = scanning_->period();
  const Instant first = first_tick(lead, turn) + fleet.tick_delay(turn) + scanning_->sweep();
  loop_.every(first, turn, Priority::node, [this](Instant now) { scan(now); });
}

void SimNode::subscribe_to_commands(bool autonomous) {
  subscribe_in_run<twist_t>(
      bus_, loop_, autonomous ? channels_.vehicle_drive : channels_.vehicle_command, kDeepQueue,
      rejected_, [this](const twist_t& m) {
        on_command(from_utime(m.utime) - clock_offset_, m.seq, {m.v_mps, m.omega_radps});
      });
  if (autonomous) return;
  subscribe_to_plans(bus_, loop_, channels_, rejected_plans_, [this](PlanSource source, Plan plan) {
    plan.stamp -= clock_offset_;  // to the run's time, as the vehicle's clock has it
    plan.start -= clock_offset_;
    plan.settled -= clock_offset_;
    arrived_.push_back({loop_.now(), ArrivedPlan{source, std::move(plan)}});
  });
}

void SimNode::on_command(Instant stamp, std::int64_t seq, const Twist& twist) {
  if (!is_usable(twist)) {
    ++non_finite_;
    return;
  }
  const Instant now = loop_.now();
  if (guard_.accept(now, stamp, seq)) arrived_.push_back({now, twist});
}

void SimNode::take_commands(Instant until) {
  auto next = arrived_.begin();
  for (; next != arrived_.end() && next->arrival <= until; ++next) {
    if (auto* plan = std::get_if<ArrivedPlan>(&next->what)) {
      actuator_.on_plan(next->arrival, plan->source, std::move(plan->plan));
    } else {
      actuator_.on_command(next->arrival, std::get<Twist>(next->what));
    }
  }
  arrived_.erase(arrived_.begin(), next);
}

/// Takes what arrived by `stamp` first, because the step that begins then uses it.
PlanName SimNode::plan_at(Instant stamp) {
  if (plan_watch_) return plan_watch_->plan();
  take_commands(stamp);
  return actuator_.plan();
}

/// Whatever looks at the vehicle moves it up to then first, and with it those that it may touch.
void SimNode::advance(Instant until) {
  if (traffic_ != nullptr) {
    traffic_->advance(number_in_traffic_, until);
  } else {
    make_steps(until);
  }
}

void SimNode::make_steps(Instant until) {
  const Instant last = std::min(until, world_end_);
  while (next_step_ <= last) {
    if (next_step_ > end_) publish_truth();  // the last one
    next_step_ += step_ * take_steps(last);
  }
}

/// Takes one step, or several equal ones at once; returns how many.
std::int64_t SimNode::take_steps(Instant last) {
  const Instant from = next_step_ - step_;
  vehicle_->set_wheel_targets(wheel_targets(from));
  const Plant::Steps steps = vehicle_->take(may_be_equal_ ? equal_steps(from, last) : 1, from);
  world_time_ = from + step_ * steps.taken;
  if (scanning_) scanning_->record(world_time_, vehicle_->state().pose);
  if (odometry_ && (world_time_ - kStart) % kEncoderPeriod == Duration{0}) read_encoders();
  if (world_time_ <= end_) measure(steps);
  return steps.taken;
}

/// Counts the steps that end by `last`, begin before something changes, and are not observed.
std::int64_t SimNode::equal_steps(Instant from, Instant last) const {
  const auto begun_within = [this](Duration time) { return (time + step_ - Duration{1}) / step_; };
  Instant change = std::min(last, actuator_.unchanged_until(from));
  if (!arrived_.empty()) change = std::min(change, arrived_.front().arrival);
  const std::int64_t most = std::min({(last - from) / step_, begun_within(change - from),
                                      begun_within(metrics_step_ - unmeasured_)});
  return std::max<std::int64_t>(1, most);
}

void SimNode::measure(const Plant::Steps& steps) {
  unmeasured_ += step_ * steps.taken;
  unmeasured_contact_ += step_ * steps.in_contact;
  const bool is_last = world_time_ + step_ > end_;
  if (unmeasured_ < metrics_step_ && !is_last) return;
  metrics_.add(to_seconds(unmeasured_), error_m(), to_seconds(unmeasured_contact_));
  unmeasured_ = unmeasured_contact_ = Duration{0};
}

WheelSpeeds SimNode::wheel_targets(Instant from) {
  if (drives_) return drives_->in_force(from);
  if (!arrived_.empty()) take_commands(from);
  return drive_errors_.step(actuator_.in_force(from), to_seconds(step_));
}

void SimNode::sample_pose(Instant now) {
  if (now > end_) return;
  advance(now);
  const std::optional<Pose2> measured = sensor_.measure(vehicle_->state().pose);
  if (!measured) {
    ++dropped_poses_;
    return;
  }
  if (pose_sending_ && !pose_sending_->is_due(now, *measured)) return;
  const Instant stamp = std::min(world_time_, now);
  const PlanName plan = plan_at(stamp);
  pose_t message{};
  message.utime = to_utime(stamp + clock_offset_);
  message.run = loop_.run_id();
  message.seq = pose_seq_++;
  message.x_m = measured->x_m;
  message.y_m = measured->y_m;
  message.yaw_rad = measured->yaw_rad;
  message.plan_session = plan.session;
  message.plan_id = plan.id;
  if (sensor_latency_ == Duration{0}) {
    publish(bus_, channels_.vehicle_pose, message);
  } else {
    loop_.at(now + sensor_latency_, Priority::node,
             [this, message](Instant) { publish(bus_, channels_.vehicle_pose, message); });
  }
}

void SimNode::read_encoders() {
  const VehicleState s = vehicle_->state();
  odometry_->update(s.left_wheel_angle_rad, s.right_wheel_angle_rad);
}

void SimNode::publish_odometry(Instant now) {
  if (now > end_) return;
  advance(now);
  read_encoders();
  const DeadReckoning s = odometry_->state();
  const Twist twist = odometry_->twist(vehicle_->state().rim_speeds);
  const Instant stamp = std::min(world_time_, now) + clock_offset_;
  publish(bus_, channels_.vehicle_odometry, odometry_message(stamp, odometry_seq_++, s, twist));
}

void SimNode::scan(Instant now) {
  if (now > end_) return;
  advance(now);
  std::vector<Shape> others;
  if (traffic_ != nullptr) {
    others = traffic_->seen_from(number_in_traffic_, now, scanning_->range_max_m());
  }
  scanning_->publish_turn(now, plan_at(std::min(world_time_, now)), std::move(others));
}

void SimNode::publish_clock(Instant now) {
  clock_t message{};
  message.run = loop_.run_id();
  message.utime = to_utime(now);
  message.seq = clock_seq_++;
  message.rate = loop_.rate();
  publish(bus_, channels_.clock, message);
}

void SimNode::publish_truth() {
  if (world_time_ > end_ || (truth_seq_ > 0 && last_truth_ == world_time_)) return;
  last_truth_ = world_time_;
  const VehicleState s = vehicle_->state();
  const Position reference = this->reference();
  ground_truth_t message{};
  message.utime = to_utime(world_time_);
  message.seq = truth_seq_++;
  message.x_m = s.pose.x_m;
  message.y_m = s.pose.y_m;
  message.yaw_rad = s.pose.yaw_rad;
  message.v_mps = s.twist.v_mps;
  message.omega_radps = s.twist.omega_radps;
  message.left_rim_mps = s.rim_speeds.left_mps;
  message.right_rim_mps = s.rim_speeds.right_mps;
  message.left_torque_Nm = s.left_torque_Nm;
  message.right_torque_Nm = s.right_torque_Nm;
  message.x_ref_m = reference.x_m;
  message.y_ref_m = reference.y_m;
  message.error_m = error_m();
  message.epsilon_m = metrics_.epsilon_m();
  message.rmse_m = metrics_.rmse_m();
  message.max_error_m = metrics_.max_error_m();
  message.wall_contact_s = metrics_.wall_contact_s();
  message.settled_epsilon_m = metrics_.settled_epsilon_m();
  message.settled_max_error_m = metrics_.settled_max_error_m();
  message.lost_from_s = metrics_.lost_from_s();
  message.return_s = metrics_.return_s();
  message.away_s = metrics_.away_s();
  message.lost = metrics_.lost() ? 1 : 0;
  message.wall_contact = s.wall_contact ? 1 : 0;
  publish(bus_, channels_.truth, message);
}

Position SimNode::reference() const { return path_->position_at(to_seconds(world_time_)); }

/// On the floor: where the chassis is pitched, its shadow.
Position SimNode::controlled_point() const {
  if (point_ahead_m_ == 0.0) return vehicle_->position();
  return point_ahead(vehicle_->state().pose, point_ahead_m_);
}

double SimNode::error_m() const {
  const Position reference = this->reference();
  const Position position = controlled_point();
  return std::hypot(reference.x_m - position.x_m, reference.y_m - position.y_m);
}

void SimNode::finish() {
  advance(loop_.now());
  take_commands(loop_.now());  // for the counters: the world may have ended before
  publish_truth();
  counters_.publish_now();
}

void SimNode::list_counters(CounterList& out) const {
  guard_.list("command", out);
  rejected_.list("command", out);
  out.emplace_back("command.non_finite", non_finite_);
  senders_.list(out);
  if (dropped_poses_ > 0) out.emplace_back("pose.dropped", dropped_poses_);
  if (pose_sending_) {
    out.emplace_back("pose.sampled", pose_sending_->sampled());
    out.emplace_back("pose.sent", pose_sending_->sent());
  }
  if (traffic_ != nullptr) out.emplace_back("collisions", collisions());
  if (drives_) drives_->list(out);
  if (plan_watch_) plan_watch_->list(out);
  if (!drives_) actuator_.list(out);
  if (!drives_ && actuator_.takes_plans()) {
    rejected_plans_.list("plan", out);
  }
  out.emplace_back("physics.solver_complaints",
                   static_cast<std::int64_t>(vehicle_->solver_complaints()));
}

SimFleet::SimFleet(const std::vector<Scenario>& members, EventLoop& loop, Bus& bus) {
  if (members.size() > 1) {
    traffic_.emplace(step_of(members.front().get<WorldSettings>()), std::max(kStart, loop.now()));
  }
  for (const Scenario& member : members) {
    nodes_.add(std::make_unique<SimNode>(member, loop, bus, traffic_ ? &*traffic_ : nullptr));
  }
}

}  // namespace tether
