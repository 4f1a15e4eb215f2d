#pragma once

#include <cstdint>
#include <tether/plan_in_force_t.hpp>

#include "common/actuator/plan.hpp"
#include "common/bus/channel_names.hpp"
#include "common/bus/message_io.hpp"
#include "common/bus/stream_guard.hpp"
#include "common/loop/event_loop.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

/// With drives on CAN only the bridge knows which plan the vehicle follows: it says so on CAN/PLAN,
/// and the sensor stamps its poses with the newest that it has heard. Before the first they name
/// none. Undecodable, duplicated and late messages are counted and change nothing.
class PlanWatch {
 public:
  /// `loop` and `bus` must outlive the watch.
  PlanWatch(const Sections<RunSettings, VehicleSettings>& settings, EventLoop& loop, Bus& bus)
      : guard_({.earliest = kStart - from_seconds(settings.get<RunSettings>().lead_s)}) {
    subscribe<plan_in_force_t>(bus, ChannelNames(settings.get<VehicleSettings>().name).can_plan,
                               kDeepQueue, undecodable_, [this, &loop](const plan_in_force_t& m) {
                                 if (!guard_.accept(loop.now(), from_utime(m.utime), m.seq)) return;
                                 plan_ = {m.session, m.id};
                               });
  }
  PlanWatch(const PlanWatch&) = delete;
  PlanWatch& operator=(const PlanWatch&) = delete;

  PlanName plan() const { return plan_; }

  /// Appends plan_in_force.….
  void list(CounterList& out) const {
    guard_.list("plan_in_force", out);
    out.emplace_back("plan_in_force.undecodable", undecodable_);
  }

 private:
  StreamGuard guard_;
  PlanName plan_;
  std::int64_t undecodable_ = 0;
};

}  // namespace tether
