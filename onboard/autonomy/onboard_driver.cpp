#include "onboard/autonomy/onboard_driver.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <set>
#include <utility>

#include "common/path/controlled_point.hpp"
#include "common/path/kinds.hpp"
#include "common/vehicle/frames.hpp"
#include "controller/laws/axle_path.hpp"
#include "onboard/autonomy/swept_way.hpp"

namespace tether {

SightedPoints::SightedPoints(const std::vector<Shape>& mapped) {
  for (const Shape& shape : mapped) {
    const double reach_m = shape.outline == Shape::Outline::circle
                               ? shape.radius_m
                               : 0.5 * std::hypot(shape.length_m, shape.width_m);
    known_.push_back({shape, reach_m});
  }
}

bool SightedPoints::is_mapped(const Position& p) const {
  return std::any_of(known_.begin(), known_.end(), [&p](const Known& known) {
    const double within_m = known.reach_m + kMapped_m;
    return std::abs(p.x_m - known.shape.pose.x_m) < within_m &&
           std::abs(p.y_m - known.shape.pose.y_m) < within_m &&
           distance_m(known.shape, p) < kMapped_m;
  });
}

std::vector<Position> SightedPoints::unmapped(const std::vector<Position>& points,
                                              const Pose2& vehicle, std::size_t most) const {
  std::vector<Position> near;
  for (const Position& p : points) {
    if (p.x_m * p.x_m + p.y_m * p.y_m < kRange_m * kRange_m) near.push_back(p);
  }
  std::stable_sort(near.begin(), near.end(), [](const Position& a, const Position& b) {
    return a.x_m * a.x_m + a.y_m * a.y_m < b.x_m * b.x_m + b.y_m * b.y_m;
  });
  std::vector<Position> unmapped;
  std::set<std::pair<std::int64_t, std::int64_t>> taken;
  for (const Position& p : near) {
    if (unmapped.size() >= most) break;
    const Position world = from_frame(vehicle, p);
    const auto cell =
        std::pair{std::llround(world.x_m / kApart_m), std::llround(world.y_m / kApart_m)};
    if (!taken.contains(cell) && !is_mapped(world)) {
      taken.insert(cell);
      unmapped.push_back(world);
    }
  }
  return unmapped;
}

namespace {

/// Slower than this the path rests, or begins to move: its clock goes on by itself.
constexpr double kRests_mps = 0.3;
constexpr double kSample_s = 0.1;

LawSettings on_board(LawSettings settings) {
  auto& controller = settings.get<ControllerSettings>();
  controller.law = "tracking";
  controller.estimator = ControllerSettings::Estimator::none;
  return settings;
}

}  // namespace

std::shared_ptr<const ReferencePath> axle_path(
    const Sections<PathSettings, VehicleSettings>& settings) {
  auto path = make_path(settings.get<PathSettings>());
  const double ahead_m =
      controlled_point_ahead_m(settings.get<PathSettings>(), settings.get<VehicleSettings>());
  if (ahead_m == 0.0) return path;
  return std::make_shared<AxlePath>(path, ahead_m);
}

PathFollower::PathFollower(const LawSettings& settings)
    : path_(axle_path(settings)), law_(make_law(on_board(settings))) {}

Twist PathFollower::wanted(const Pose2& pose, double path_s) {
  SeenPose seen;
  seen.pose = pose;
  const Instant when = kStart + from_seconds(path_s);
  seen.stamp = seen.arrival = when;
  const auto twist = std::get<Twist>(law_->decide(when, &seen));
  return twist.v_mps < 0.0 ? Twist{} : twist;
}

void PathFollower::advance(double dt_s, double v_mps) {
  const double own_mps = path_->at(clock_s_).v_mps;
  const double share = own_mps < kRests_mps ? 1.0 : std::clamp(v_mps / own_mps, 0.0, 1.0);
  const Position before = path_->position_at(clock_s_);
  clock_s_ += share * dt_s;
  way_m_ += distance_m(before, path_->position_at(clock_s_));
}

std::optional<double> PathFollower::place_of(const Pose2& pose) const {
  const Position here{pose.x_m, pose.y_m};
  double nearest_m = kOnPath_m;
  std::optional<double> place;
  for (int i = 0; i * kSample_s <= kSearch_s; ++i) {
    const double t_s = clock_s_ + i * kSample_s;
    const double off_m = distance_m(path_->position_at(t_s), here);
    if (place && off_m > kOnPath_m) break;  // beyond the first stretch that is near enough
    if (off_m >= nearest_m) continue;
    if (std::abs(wrap_angle(path_->at(t_s).yaw_rad - pose.yaw_rad)) > kOnPath_rad) continue;
    nearest_m = off_m;
    place = t_s;
  }
  return place;
}

void PathFollower::go_to(double path_s) {
  for (double t_s = clock_s_; t_s < path_s; t_s += kSample_s) {
    way_m_ +=
        distance_m(path_->position_at(t_s), path_->position_at(std::min(t_s + kSample_s, path_s)));
  }
  clock_s_ = std::max(clock_s_, path_s);
}

std::vector<Pose2> PathFollower::way(double path_s, double length_m) const {
  std::vector<Pose2> poses;
  double way_m = 0.0;
  Position before = path_->position_at(path_s);
  for (int i = 0; way_m <= length_m && i * kSample_s <= kSearch_s; ++i) {
    const PathPoint p = path_->at(path_s + i * kSample_s);
    way_m += distance_m(before, {p.x_m, p.y_m});
    before = {p.x_m, p.y_m};
    poses.push_back({p.x_m, p.y_m, p.yaw_rad});
    if (i > 0 && p.v_mps == 0.0) break;  // its end
  }
  return poses;
}

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
