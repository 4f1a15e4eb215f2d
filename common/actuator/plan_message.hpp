#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <tether/plan_t.hpp>

#include "common/actuator/plan.hpp"
#include "common/bus/bus.hpp"
#include "common/bus/channel_names.hpp"
#include "common/bus/message_io.hpp"

namespace tether {

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
