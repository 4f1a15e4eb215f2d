#include "netem/medium/divergence.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <tether/plan_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/twist_t.hpp>

#include "common/node/message_io.hpp"
#include "common/vehicle/plan.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {
namespace {

constexpr double kLever_m = 1.0;
constexpr Duration kAhead = std::chrono::seconds{1};

using Bytes = std::vector<std::uint8_t>;

template <class Message>
std::optional<Message> as(const Bytes& bytes) {
  Message message{};
  if (!decode(bytes, message)) return std::nullopt;
  return message;
}

double between(const pose_t& a, const pose_t& b) {
  const auto x = [](const pose_t& p) { return p.x_m + kLever_m * std::cos(p.yaw_rad); };
  const auto y = [](const pose_t& p) { return p.y_m + kLever_m * std::sin(p.yaw_rad); };
  return std::hypot(x(a) - x(b), y(a) - y(b));
}

/// On an arc, by its chord.
void drive(Pose2& pose, const Twist& twist, double dt_s) {
  const double half_rad = 0.5 * twist.omega_radps * dt_s;
  const double chord_m =
      twist.v_mps * dt_s * (half_rad == 0.0 ? 1.0 : std::sin(half_rad) / half_rad);
  pose.x_m += chord_m * std::cos(pose.yaw_rad + half_rad);
  pose.y_m += chord_m * std::sin(pose.yaw_rad + half_rad);
  pose.yaw_rad += 2.0 * half_rad;
}

/// Its twists alone; without them if what it says is in no range that clocks have.
Plan twists_of(const plan_t& m) {
  constexpr std::int64_t kLatest_us = 1'000'000'000'000'000;
  Plan plan;
  if (m.step_us <= 0 || m.start_utime < -kLatest_us || m.start_utime > kLatest_us) return plan;
  plan.start = from_utime(m.start_utime);
  plan.step = std::chrono::microseconds{m.step_us};
  for (std::size_t k = 0; k < m.v_mps.size(); ++k) {
    plan.twists.push_back({m.v_mps[k], m.omega_radps[k]});
  }
  return plan;
}

double between(const Plan& newer, const Plan& known) {
  if (newer.twists.empty() || known.twists.empty()) return 0.0;
  if (known.end() <= newer.start) return std::numeric_limits<double>::infinity();
  const Instant end = std::min({newer.start + kAhead, newer.end(), known.end()});
  Pose2 a{}, b{};
  double most_m = 0.0;
  for (Instant t = newer.start; t < end;) {
    const auto next_of = [t](const Plan& plan) {
      const Duration into = t - plan.start;
      return into < Duration{0} ? plan.start : t + plan.step - into % plan.step;
    };
    const Instant next = std::min({end, next_of(newer), next_of(known)});
    drive(a, newer.at(t), to_seconds(next - t));
    drive(b, known.at(t), to_seconds(next - t));
    most_m = std::max(most_m, distance_m(a, b));
    t = next;
  }
  return most_m;
}

Plan held(const twist_t& twist) {
  Plan plan;
  plan.start = kStart;
  plan.step = kAhead;
  plan.twists = {{twist.v_mps, twist.omega_radps}};
  return plan;
}

}  // namespace

double divergence_m(const Bytes& newer, const Bytes& known) {
  double way_m = 0.0;
  if (const auto a = as<pose_t>(newer), b = as<pose_t>(known); a && b) {
    way_m = between(*a, *b);
  } else if (const auto c = as<plan_t>(newer), d = as<plan_t>(known); c && d) {
    way_m = between(twists_of(*c), twists_of(*d));
  } else if (const auto e = as<twist_t>(newer), f = as<twist_t>(known); e && f) {
    way_m = between(held(*e), held(*f));
  }
  return std::isnan(way_m) ? 0.0 : way_m;
}

}  // namespace tether
