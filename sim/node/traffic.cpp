#include "sim/node/traffic.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <numeric>

namespace tether {
namespace {

double mass_of(const VehicleConfig& v) {
  return v.chassis_mass_kg + 2.0 * v.wheel_mass_kg + v.caster_mass_kg + v.payload_kg;
}

/// The chassis' centre.
Position middle(const VehicleConfig& vehicle, const VehicleState& state) {
  const Pose2& axle = state.pose;
  return {axle.x_m - vehicle.axle_x_m * std::cos(axle.yaw_rad),
          axle.y_m - vehicle.axle_x_m * std::sin(axle.yaw_rad)};
}

double speed_mps(const Plant& plant) { return std::abs(plant.state().twist.v_mps); }

/// State at the beginning of a step.
struct Motion {
  Footprint outline;
  double vx_mps, vy_mps;
};

Motion motion_of(const VehicleConfig& vehicle, const VehicleState& state) {
  return {footprint(vehicle, state.pose), state.twist.v_mps * std::cos(state.pose.yaw_rad),
          state.twist.v_mps * std::sin(state.pose.yaw_rad)};
}

/// Where they overlap by this, both plants feel it in the same step: what one loses the other
/// gains.
constexpr double kOverlap_m = 5e-4;
/// Beyond each other's reach by more than this, two vehicles do not touch in the next step.
constexpr double kClose_m = 0.15;
/// So much more than their speeds say two vehicles may come nearer within the horizon.
constexpr double kSlack_m = 0.3;

}  // namespace

std::size_t Traffic::add(const VehicleConfig& vehicle, Plant& plant,
                         std::function<void(Instant)> move) {
  vehicles_.push_back({.move = std::move(move),
                       .plant = &plant,
                       .reach_m = reach_m(vehicle),
                       .radius_m = reach_m(vehicle, -vehicle.axle_x_m),
                       .mass_kg = mass_of(vehicle),
                       .config = vehicle});
  times_.push_back(kStart);
  return vehicles_.size() - 1;
}

void Traffic::advance(std::size_t vehicle, Instant until) {
  while (until > looked_until_) look();
  move(vehicle, until);
}

void Traffic::move(std::size_t vehicle, Instant until) {
  const std::vector<std::size_t>& cluster = vehicles_[vehicle].cluster;
  if (cluster.empty()) {
    vehicles_[vehicle].move(until);
    return;
  }
  while (times_[vehicle] + step_ <= until) step(cluster, times_[vehicle] + step_);
}

void Traffic::step(const std::vector<std::size_t>& cluster, Instant end) {
  for (const std::size_t i : cluster) vehicles_[i].touchable.clear();
  for (const std::size_t i : cluster) {
    for (const std::size_t j : vehicles_[i].near) {
      if (j > i) meet(i, j);
    }
  }
  for (const std::size_t i : cluster) {
    vehicles_[i].plant->set_vehicles(vehicles_[i].touchable);
    vehicles_[i].move(end);
    times_[i] = end;
  }
}

/// Shows them to each other if they may touch in the step that begins.
void Traffic::meet(std::size_t a, std::size_t b) {
  Vehicle& one = vehicles_[a];
  Vehicle& other = vehicles_[b];
  const double between_m = distance_m(one.plant->position(), other.plant->position());
  if (between_m > one.reach_m + other.reach_m + kClose_m) return note_contact(a, b, INFINITY);
  const VehicleState state = one.plant->state(), its = other.plant->state();
  if (distance_m(middle(one.config, state), middle(other.config, its)) >
      one.radius_m + other.radius_m + kClose_m) {
    return note_contact(a, b, INFINITY);
  }
  const Motion of_one = motion_of(one.config, state);
  const Motion of_other = motion_of(other.config, its);
  const double gap = gap_m(of_one.outline, of_other.outline);
  note_contact(a, b, gap);
  if (gap > -kOverlap_m) return;
  const double share = one.mass_kg / (one.mass_kg + other.mass_kg);
  const double vx_mps = share * of_one.vx_mps + (1.0 - share) * of_other.vx_mps;
  const double vy_mps = share * of_one.vy_mps + (1.0 - share) * of_other.vy_mps;
  const auto show = [&](const Motion& motion, Vehicle& to) {
    for (Shape shape : motion.outline) {
      shape.vx_mps = vx_mps;
      shape.vy_mps = vy_mps;
      to.touchable.push_back(shape);
    }
  };
  show(of_other, one);
  show(of_one, other);
}

void Traffic::note_contact(std::size_t a, std::size_t b, double gap_m) {
  if (gap_m > kParted_m) {
    touching_.erase({a, b});
  } else if (gap_m <= kTouching_m && touching_.insert({a, b}).second) {
    ++vehicles_[a].collisions;
    ++vehicles_[b].collisions;
  }
}

/// Who may touch whom within the next kHorizon.
void Traffic::look() {
  const Instant now = looked_until_;
  looked_until_ += kHorizon;
  const std::size_t count = vehicles_.size();
  for (std::size_t i = 0; i < count; ++i) move(i, now);
  const Instant last_step = std::max(kStart, kStart + (now - kStart) / step_ * step_);
  std::vector<std::size_t> first(count);  // first vehicle of each group
  std::iota(first.begin(), first.end(), std::size_t{0});
  const auto root = [&first](std::size_t i) {
    while (first[i] != i) i = first[i];
    return i;
  };
  for (Vehicle& vehicle : vehicles_) {
    vehicle.near.clear();
    if (vehicle.cluster.empty()) continue;
    vehicle.cluster.clear();
    vehicle.plant->set_vehicles({});
  }
  for (const auto& [i, j] : near_pairs()) {
    vehicles_[i].near.push_back(j);
    vehicles_[j].near.push_back(i);
    first[std::max(root(i), root(j))] = std::min(root(i), root(j));
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (!vehicles_[i].near.empty()) vehicles_[root(i)].cluster.push_back(i);
    times_[i] = last_step;
  }
  for (std::size_t i = 0; i < count; ++i) vehicles_[i].cluster = vehicles_[root(i)].cluster;
}

/// Pairs that may touch within the next kHorizon, in ascending order, the lower number first.
std::vector<std::pair<std::size_t, std::size_t>> Traffic::near_pairs() const {
  struct Place {
    Position at;
    double way_m;
    std::size_t vehicle;
  };
  std::vector<Place> places;
  double longest_way_m = 0.0;
  for (const Vehicle& vehicle : vehicles_) {
    const double way_m = vehicle.reach_m + speed_mps(*vehicle.plant) * to_seconds(kHorizon);
    places.push_back({vehicle.plant->position(), way_m, places.size()});
    longest_way_m = std::max(longest_way_m, way_m);
  }
  std::sort(places.begin(), places.end(), [](const Place& a, const Place& b) {
    return std::is_lt(std::strong_order(a.at.y_m, b.at.y_m));
  });
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (auto a = places.begin(); a != places.end(); ++a) {
    for (auto b = a + 1; b != places.end(); ++b) {
      const double near_m = a->way_m + b->way_m + kSlack_m;
      const double x_m = b->at.x_m - a->at.x_m, y_m = b->at.y_m - a->at.y_m;
      if (y_m > a->way_m + longest_way_m + kSlack_m) break;
      if (x_m * x_m + y_m * y_m > near_m * near_m) continue;
      pairs.push_back(std::minmax(a->vehicle, b->vehicle));
    }
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

std::vector<Shape> Traffic::seen_from(std::size_t number, Instant now, double range_m) {
  std::vector<Shape> seen;
  for (std::size_t i = 0; i < vehicles_.size(); ++i) {
    advance(i, now);
    if (i == number) continue;
    const Vehicle& other = vehicles_[i];
    const double between_m =
        distance_m(vehicles_[number].plant->position(), other.plant->position());
    if (between_m > range_m + other.reach_m) continue;
    const Motion its = motion_of(other.config, other.plant->state());
    for (Shape shape : its.outline) {
      shape.vx_mps = its.vx_mps;
      shape.vy_mps = its.vy_mps;
      seen.push_back(shape);
    }
    Shape& chassis = seen[seen.size() - its.outline.size()];
    chassis.clearance_m = std::max(0.0, chassis.height_m - other.config.chassis_height_m);
  }
  return seen;
}

}  // namespace tether
