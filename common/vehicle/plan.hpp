#pragma once

#include <algorithm>
#include <cassert>
#include <cstdint>
#include <optional>
#include <string>
#include <tether/plan_t.hpp>
#include <vector>

#include "common/base/time.hpp"
#include "common/node/bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/message_io.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// Which plan: a session of a controller, and its number in it.
struct PlanName {
  std::int64_t session = -1;  ///< −1: none
  std::int64_t id = -1;       ///< −1: none

  bool operator==(const PlanName&) const = default;
};

/// How a plan reached the vehicle: through the relay's downlink, or handed over before departure.
enum class PlanSource { network, preload };

/// A plan_t: twists that follow each other in equal steps of time. Nothing in it is checked: see
/// PlanBuffer.
struct Plan {
  static constexpr std::int64_t kBasedOnNone = -1;
  static constexpr std::int64_t kBasedOnAny = -2;

  Instant stamp;                ///< stamp of its message
  std::optional<Instant> pose;  ///< when the pose was measured that it was predicted from
  std::int64_t seq = 0;
  PlanName name;
  std::int64_t based_on = kBasedOnAny;  ///< id of a plan of the same session, or one of the above
  /// Equal to based_on; or a later id: then the plan is based on any plan of this range that has
  /// settled.
  std::int64_t based_on_last = kBasedOnAny;
  Instant start;
  Duration step{};
  /// The plan has settled from here to its end: it predicts the vehicle where all settled plans of
  /// its session do, on the path.
  Instant settled = Instant::max();
  std::vector<Twist> twists;

  /// Whether it says to stand still all the time; an empty one says nothing.
  bool is_stop() const {
    return !twists.empty() && std::all_of(twists.begin(), twists.end(), stands_still);
  }

  /// When the last twist ends. `step` and the number of twists must be in their ranges.
  Instant end() const { return start + step * static_cast<std::int64_t>(twists.size()); }

  /// The twist in force at `t`: the first before the start, the last after the end. The plan must
  /// have a twist and step > 0.
  const Twist& at(Instant t) const {
    assert(!twists.empty() && step > Duration{0});
    return twists[static_cast<std::size_t>(number_at(t))];
  }
  /// When the twist in force at `t`, before the end, ends.
  Instant end_of_twist(Instant t) const { return start + step * (number_at(t) + 1); }

 private:
  std::int64_t number_at(Instant t) const {
    const auto last = static_cast<std::int64_t>(twists.size()) - 1;
    return std::clamp<std::int64_t>((t - start) / step, 0, last);
  }
};

static_assert(Plan::kBasedOnNone == plan_t::NONE && Plan::kBasedOnAny == plan_t::ANY);

/// The time of a message's pose_utime; none for −1, with which it says that there was no pose.
inline std::optional<Instant> pose_time(std::int64_t pose_utime) {
  if (pose_utime == -1) return std::nullopt;
  return from_utime(pose_utime);
}

/// Copies the fields as they are: nothing is checked.
inline Plan to_plan(const plan_t& m) {
  Plan plan;
  plan.stamp = from_utime(m.utime);
  plan.pose = pose_time(m.pose_utime);
  plan.seq = m.seq;
  plan.name = {m.session, m.id};
  plan.based_on = m.based_on;
  plan.based_on_last = m.based_on_last;
  plan.start = from_utime(m.start_utime);
  plan.step = std::chrono::microseconds{m.step_us};
  plan.settled = from_utime(m.settled_utime);
  plan.twists.reserve(m.v_mps.size());
  for (std::size_t k = 0; k < m.v_mps.size(); ++k) {
    plan.twists.push_back({m.v_mps[k], m.omega_radps[k]});
  }
  return plan;
}

/// Calls f(source, plan) for each plan_t of this run that reaches the vehicle.
template <class Function>
void subscribe_to_plans(Bus& bus, const EventLoop& loop, const ChannelNames& channels,
                        Rejected& rejected, Function f) {
  subscribe_in_run<plan_t>(bus, loop, channels.vehicle_plan, kDeepQueue, rejected,
                           [f](const plan_t& m) { f(PlanSource::network, to_plan(m)); });
  subscribe_in_run<plan_t>(bus, loop, channels.vehicle_preload, kDeepQueue, rejected,
                           [f](const plan_t& m) { f(PlanSource::preload, to_plan(m)); });
}

}  // namespace tether
