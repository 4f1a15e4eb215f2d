#pragma once

#include <cstdint>
#include <string>
#include <tether/plan_t.hpp>

#include "common/bus/bus.hpp"
#include "common/bus/channel_names.hpp"
#include "common/bus/message_io.hpp"
#include "common/vehicle/plan.hpp"

namespace tether {

static_assert(Plan::kBasedOnNone == plan_t::NONE && Plan::kBasedOnAny == plan_t::ANY);

/// Copies the fields as they are: nothing is checked.
inline Plan to_plan(const plan_t& m) {
  Plan plan{from_utime(m.utime),
            m.seq,
            {m.session, m.id},
            m.based_on,
            m.based_on_last,
            from_utime(m.start_utime),
            std::chrono::microseconds{m.step_us},
            from_utime(m.settled_utime),
            {}};
  plan.twists.reserve(m.v_mps.size());
  for (std::size_t k = 0; k < m.v_mps.size(); ++k) {
    plan.twists.push_back({m.v_mps[k], m.omega_radps[k]});
  }
  return plan;
}

/// Calls f(source, plan) for each plan_t that reaches the vehicle; counts what cannot be decoded.
template <class Function>
void subscribe_to_plans(Bus& bus, const ChannelNames& channels, std::int64_t& undecodable,
                        Function f) {
  subscribe<plan_t>(bus, channels.vehicle_plan, kDeepQueue, undecodable,
                    [f](const plan_t& m) { f(PlanSource::network, to_plan(m)); });
  subscribe<plan_t>(bus, channels.vehicle_preload, kDeepQueue, undecodable,
                    [f](const plan_t& m) { f(PlanSource::preload, to_plan(m)); });
}

}  // namespace tether
