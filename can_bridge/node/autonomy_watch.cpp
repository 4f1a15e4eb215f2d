#include "can_bridge/node/autonomy_watch.hpp"

#include <fmt/format.h>

#include <cmath>
#include <string>

namespace tether {

AutonomyWatch::AutonomyWatch(
    const Sections<RunSettings, VehicleSettings, CanSettings, AutonomySettings>& settings,
    EventLoop& loop, Bus& bus)
    : stopping_(settings.get<AutonomySettings>()),
      max_speed_mps_(settings.get<CanSettings>().max_speed_mps),
      guard_({.earliest = earliest_stamp(settings)}) {
  subscribe_in_run<autonomy_state_t>(
      bus, loop, ChannelNames(settings.get<VehicleSettings>().name).vehicle_autonomy, kDeepQueue,
      rejected_, [this, &loop](const autonomy_state_t& m) {
        if (!guard_.accept(loop.now(), from_utime(m.utime), m.seq)) return;
        heard_ = loop.now();
        clear_m_ = is_usable(m.clear_m) ? m.clear_m : 0.0;
      });
}

void AutonomyWatch::demand(Instant now, double speed_mps, SafetyDemands& all) const {
  std::string why;
  if (!heard_) {
    why = "autonomy: not heard yet";
  } else if (now - *heard_ > kFresh) {
    why = fmt::format("autonomy: silent for {:.0f} ms", std::floor(to_milliseconds(now - *heard_)));
  } else if (stopping_.length_m(speed_mps) > clear_m_ + kBeyond_m && std::abs(speed_mps) > 0.0) {
    why = fmt::format("autonomy: {:.2f} m free, {:.2f} m needed to stop", clear_m_,
                      stopping_.length_m(speed_mps));
  }
  if (!why.empty()) {
    // A demand that an input has made already says whether it ramps and resumes.
    if (all.stop.empty()) all.ramp = all.may_resume = true;
    all.stop += (all.stop.empty() ? "" : "; ") + why;
    return;
  }
  const double allowed_mps = stopping_.allowed_mps(clear_m_);
  if (all.speed_limit_mps.value_or(max_speed_mps_) <= allowed_mps) return;
  all.speed_limit_mps = allowed_mps;
  all.speed_limit_by = "autonomy";
}

void AutonomyWatch::list(CounterList& out) const {
  guard_.list("autonomy", out);
  rejected_.list("autonomy", out);
}

}  // namespace tether
