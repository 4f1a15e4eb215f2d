#include "autonomy/node/onboard_driver.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/vehicle/frames.hpp"

namespace tether {
namespace {

bool is_stop(const Twist& twist) { return twist.v_mps == 0.0 && twist.omega_radps == 0.0; }

/// Slower than this by its wheels the vehicle stands: encoders' steps, and what a floor shakes.
constexpr double kStands_mps = 0.02;
/// Over this time its odometer has to stand still, too, but for a count.
constexpr Duration kStandsFor = std::chrono::milliseconds{100};
constexpr double kCount_m = 0.001;

}  // namespace

OnboardDriver::OnboardDriver(const OnboardSettings& settings)
    : settings_(settings.get<AutonomySettings>()),
      pose_timeout_(from_seconds(settings_.pose_timeout_s)),
      step_s_(1.0 / settings_.rate_hz),
      field_(settings_, settings.get<VehicleSettings>()),
      follower_(settings),
      remote_(settings.get<ActuatorSettings>(), settings.get<VehicleSettings>(),
              {.earliest = earliest_stamp(settings)}),
      supervisor_(settings_, earliest_stamp(settings)),
      setpoint_({settings_.deceleration_mps2, settings_.yaw_acceleration_radps2},
                field_.outline()) {}

void OnboardDriver::on_scan(const Scan& scan) {
  const std::optional<Pose2> at_end = track_.at(scan.end());
  if (at_end) field_.see(scan, *at_end, track_.twist(scan.end()).value_or(Twist{}));
}

void OnboardDriver::on_odometry(Instant stamp, const Pose2& pose, const Twist& twist) {
  track_.add(stamp, pose, twist);
}

void OnboardDriver::on_pose(Instant stamp, const Pose2& pose) {
  poses_.push_back({stamp, pose});
  while (stamp - poses_.front().stamp > kCompared) poses_.pop_front();
  const Measured& before = poses_.front();
  const std::optional<Pose2> by_wheels = track_.moved_on(before.pose, before.stamp, stamp);
  if (by_wheels && std::hypot(by_wheels->x_m - pose.x_m, by_wheels->y_m - pose.y_m) > kApart_m) {
    apart_ = stamp;
  }
}

void OnboardDriver::on_command(Instant now, Instant stamp, std::int64_t seq, const Twist& twist,
                               std::optional<Instant> report) {
  supervisor_.hear(now, stamp, seq, is_stop(twist), report, [&] {
    remote_.on_command(now, twist);
    return true;
  });
}

void OnboardDriver::on_plan(Instant now, PlanSource source, Plan plan) {
  supervisor_.hear(now, plan.stamp, plan.seq, plan.is_stop(), plan.pose, [&] {
    // Discards the previous driver's commands, in case this plan begins later.
    if (supervisor_.state() != DriveState::remote) remote_.on_command(now, {});
    return remote_.on_plan(now, source, std::move(plan));
  });
}

std::optional<Pose2> OnboardDriver::pose_at(Instant now) const {
  if (poses_.empty() || !localiser_knows_ || now - poses_.back().stamp > pose_timeout_) {
    return std::nullopt;
  }
  return track_.moved_on(poses_.back().pose, poses_.back().stamp, now);
}

std::string OnboardDriver::unfit(Instant now) {
  if (!field_.blind().empty()) return field_.blind();
  const Twist rolls = track_.twist(now).value_or(Twist{});
  const Twist& wanted = setpoint_.twist();
  const double off_mps = pace_mps(
      {rolls.v_mps - wanted.v_mps, rolls.omega_radps - wanted.omega_radps}, field_.outline());
  if (off_mps <= kFollow_mps || setpoint_.stands()) followed_ = now;
  if (now - followed_ > kFollow) return "the wheels do not follow";
  return now - apart_ < kFollow ? "poses do not move as the wheels do" : "";
}

bool OnboardDriver::is_blocked(Instant now, const Twist& wanted) const {
  const StoppingField& stopping = field_.stopping();
  const Outline& outline = field_.outline();
  const bool cannot_go = pace_mps(wanted, outline) > kCreep_mps &&
                         stopping.allowed_mps(field_.clear_m(wanted)) < kCreep_mps;
  const Twist rolls = track_.twist(now).value_or(Twist{});
  const double pace = pace_mps(rolls, outline);
  const bool too_fast =
      pace > kTooFast_mps && pace > stopping.allowed_mps(field_.clear_m(rolls)) + kTooFast_mps;
  return cannot_go || too_fast;
}

/// Whether and where the vehicle could go on along its path; while it does, it need not be asked.
void OnboardDriver::look_along_path(Instant now, const std::optional<Pose2>& pose) {
  if (supervisor_.state() == DriveState::autonomous) {
    outlook_ = {pose.has_value(), pose.has_value(), follower_.clock_s(), now};
    return;
  }
  if (now - outlook_.when < kLook && pose) return;
  outlook_ = {false, false, follower_.clock_s(), now};
  if (!pose) return;
  const std::optional<double> place = follower_.place_of(*pose);
  if (!place) return;
  std::vector<Pose2> way = follower_.way(
      *place, field_.stopping().length_m(follower_.speed_mps(*place)) + kFreeBeyond_m);
  for (Pose2& p : way) p = relative_to(*pose, p);
  outlook_ = {true, field_.is_way_free(way), *place, now};
}

Twist OnboardDriver::wanted_by(Driver driver, Instant now, const Twist& law) const {
  if (driver == Driver::law) return law;
  return driver == Driver::remote ? remote_.in_force(now) : Twist{};
}

bool OnboardDriver::wheels_stand(Instant now) const {
  const std::optional<Twist> rolls = track_.twist(now);
  const std::optional<Pose2> before = track_.at(now - kStandsFor), present = track_.at(now);
  if (!rolls || !before || !present) return false;
  const Pose2 step = relative_to(*before, *present);
  const Twist way{std::hypot(step.x_m, step.y_m), step.yaw_rad};
  return pace_mps(*rolls, field_.outline()) < kStands_mps &&
         pace_mps(way, field_.outline()) < kStands_mps * to_seconds(kStandsFor) + kCount_m;
}

OnboardDriver::Output OnboardDriver::step(Instant now) {
  field_.update(now, track_.at(now));
  const StoppingField& stopping = field_.stopping();
  const std::optional<Pose2> pose = pose_at(now);
  look_along_path(now, pose);
  const Twist law = pose && now >= kStart ? follower_.wanted(*pose, outlook_.place_s) : Twist{};

  Supervisor::Sight sight;
  sight.localised = pose.has_value();
  sight.unfit = unfit(now);
  sight.blocked = is_blocked(now, law);
  sight.on_path = outlook_.on_path;
  sight.way_free = outlook_.way_free;
  sight.stands = setpoint_.stands() && wheels_stand(now);
  sight.several_senders = several_senders_;
  const DriveState before = supervisor_.state();
  supervisor_.step(now, sight);
  if (supervisor_.state() == DriveState::autonomous && before != DriveState::autonomous) {
    follower_.go_to(outlook_.place_s);
  }

  Output out;
  out.state = supervisor_.state();
  out.driver = sight.unfit.empty() ? supervisor_.driver(now) : Driver::none;
  out.pose = pose;
  const Twist target = wanted_by(out.driver, now, law);
  const double clear_of_target_m = field_.clear_m(out.driver == Driver::none ? law : target);
  const double clear_m = setpoint_.stands() ? clear_of_target_m : field_.clear_m(setpoint_.twist());
  const double most_mps =
      out.driver == Driver::remote ? settings_.remote_speed_mps : kLargestUsable;
  const double allowed_mps = std::min(stopping.allowed_mps(clear_m), most_mps);
  const double target_mps = std::min(stopping.allowed_mps(clear_of_target_m), most_mps);
  out.setpoint =
      setpoint_.step(slowed_to(target, field_.outline(), target_mps), allowed_mps, step_s_);
  out.clear_m = std::min(clear_m, clear_of_target_m);
  out.field_m = stopping.length_m(pace_mps(out.setpoint, field_.outline()));
  const bool on_its_path = out.driver == Driver::law || out.state == DriveState::protective_stop;
  if (now >= kStart && on_its_path && (out.driver == Driver::law || !setpoint_.stands())) {
    follower_.advance(step_s_, out.setpoint.v_mps);
  }
  return out;
}

double OnboardDriver::late_s(Instant now) const {
  return std::max(to_seconds(now) - follower_.clock_s(), 0.0);
}

void OnboardDriver::list(CounterList& out) const {
  supervisor_.list(out);
  remote_.list(out);
}

}  // namespace tether
