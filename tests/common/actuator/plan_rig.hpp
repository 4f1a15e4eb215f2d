#pragma once

#include <cstddef>
#include <cstdint>
#include <tether/plan_t.hpp>
#include <vector>

#include "common/base/time.hpp"
#include "common/vehicle/plan.hpp"

namespace tether::test {

/// A plan of `count` twists of `twist`, each for 100 ms, stamped and starting at `start`.
inline Plan plan(Instant start, std::int64_t id, std::int64_t based_on = Plan::kBasedOnAny,
                 Twist twist = {1.0, 0.5}, std::size_t count = 10) {
  Plan plan;
  plan.stamp = start;
  plan.pose = start;
  plan.seq = id;
  plan.name = {7, id};
  plan.based_on = plan.based_on_last = based_on;
  plan.start = start;
  plan.step = std::chrono::milliseconds{100};
  plan.twists.assign(count, twist);
  return plan;
}

inline plan_t to_message(const Plan& plan) {
  plan_t m{};
  m.utime = to_utime(plan.stamp);
  m.seq = plan.seq;
  m.session = plan.name.session;
  m.id = plan.name.id;
  m.based_on = plan.based_on;
  m.based_on_last = plan.based_on_last;
  m.pose_utime = plan.pose ? to_utime(*plan.pose) : plan_t::NONE;
  m.start_utime = to_utime(plan.start);
  m.settled_utime = to_utime(plan.settled);
  m.step_us = static_cast<std::int32_t>(plan.step / std::chrono::microseconds{1});
  m.count = static_cast<std::int32_t>(plan.twists.size());
  for (const Twist& twist : plan.twists) {
    m.v_mps.push_back(static_cast<float>(twist.v_mps));
    m.omega_radps.push_back(static_cast<float>(twist.omega_radps));
  }
  return m;
}

}  // namespace tether::test
