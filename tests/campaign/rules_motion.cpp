#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <tether/drivetrain_state_t.hpp>
#include <utility>

#include "tests/campaign/rules.hpp"

namespace tether::campaign {
namespace {

/// Wheels slower than this stand: standstill_radps of drivetrains/two_node_cia402.toml (0.05) at a
/// radius of 0.4 m.
constexpr double kStands_mps = 0.02;
/// Quick stop and fault reaction of these drives (0x6085 = 19200).
constexpr double kQuickStop_mps2 = 4.0;
/// A drive without setpoints brakes by itself (0x1400:5 = 100 ms); with a tick of its own and one
/// of the wheels' reports.
constexpr Duration kDriveDeadline = std::chrono::milliseconds{120};
/// And without heartbeats by its watchdog (0x1016 = 250 ms).
constexpr Duration kHeartbeat = std::chrono::milliseconds{250};
/// How long the wheels lag behind the drives' ramps: servo, ticks, reports.
constexpr Duration kServoLag = std::chrono::milliseconds{50};
/// Effect that an unknown sender's frame may have before the bridge's next frames are in force.
constexpr Duration kForeignReach = std::chrono::milliseconds{60};

/// Jerk limits delay a ramp by 0.1 s and two cycles at most (TwistLimiter::stop); one cycle until
/// the bridge notices, two of drives and SYNC.
Duration reaction(const Limits& limits) {
  return std::chrono::milliseconds{100} + 5 * limits.cycle;
}

/// While the wheels may turn: intervals in any order, merged by sorted().
class Permission {
 public:
  void add(Instant from, Instant until) {
    if (from < until) intervals_.push_back({from, until});
  }
  const std::vector<Interval>& sorted() {
    std::sort(intervals_.begin(), intervals_.end(),
              [](const Interval& a, const Interval& b) { return a.from < b.from; });
    std::vector<Interval> merged;
    for (const Interval& i : intervals_) {
      if (merged.empty() || i.from > merged.back().until) {
        merged.push_back(i);
      } else {
        merged.back().until = std::max(merged.back().until, i.until);
      }
    }
    intervals_ = std::move(merged);
    return intervals_;
  }

 private:
  std::vector<Interval> intervals_;
};

/// An unknown sender's frames move drives for a while, whatever the bridge does.
void permit_unknown_senders(const Record& record, Permission& permission) {
  for (const Instant t : record.foreign) permission.add(t, t + kForeignReach);
}

/// The bridge is suspended, killed or cut off.
bool silences(const Fault& fault) {
  return fault.kind == FaultKind::bridge_stalls || fault.kind == FaultKind::bridge_restarted ||
         fault.kind == FaultKind::bus_off || fault.kind == FaultKind::bus_down ||
         fault.kind == FaultKind::bus_stalled;
}

/// Without the bridge the drives hold their last setpoint, until they notice.
void permit_silence(const Record& record, Permission& permission) {
  for (const Fault& fault : record.faults) {
    if (silences(fault)) permission.add(fault.when, fault.when + kDriveDeadline);
  }
}

/// A drive that an unknown sender took out of "operational" has no deadline of setpoints. One that
/// an unknown sender switches on again while the bridge is suspended turns until that is back.
void permit_intruder_alone(const Record& record, Permission& permission) {
  const auto taken_out_by = [&record](Instant t) {
    return std::any_of(record.faults.begin(), record.faults.end(), [t](const Fault& fault) {
      return fault.kind == FaultKind::nmt && fault.when <= t;
    });
  };
  for (const Fault& silence : record.faults) {
    if (!silences(silence)) continue;
    for (const Instant t : record.foreign) {
      if (t < silence.when || t > silence.until || !taken_out_by(t)) continue;
      permission.add(t, silence.until + 2 * record.limits.cycle);
    }
  }
}

/// How long an unknown sender's NMT command keeps a wheel from the bridge's setpoints and stops.
/// A drive that an unknown sender took out of "operational" takes no setpoint, and NMT "start"
/// begins its deadline of setpoints again. If it refuses the stop by SDO, too, heartbeats are
/// withheld (0.2 s) until its watchdog acts (0x1016 = 250 ms); a bridge that restarts listens, and
/// asks as long.
Interval nmt_reach(const Record& record, const Fault& nmt, std::size_t wheel) {
  constexpr Duration kConfirms = std::chrono::milliseconds{200};
  Interval reach{nmt.when, nmt.when + kDriveDeadline};
  for (const Fault& f : record.faults) {
    // Without a bridge only the drive's watchdog of heartbeats is left.
    if (!silences(f) || f.when > reach.until || f.until < nmt.when) continue;
    reach.until = std::max(reach.until, f.when + kHeartbeat + record.limits.cycle);
  }
  const bool refuses = std::any_of(record.faults.begin(), record.faults.end(), [&](const Fault& f) {
    return f.kind == FaultKind::sdo_abort && f.node == static_cast<int>(wheel) + 1 &&
           f.when <= nmt.when + kConfirms && f.until >= nmt.when;
  });
  if (!refuses) return reach;
  // One cycle until the bridge notices, one until it withholds, one of the drive.
  reach.until = std::max(reach.until, nmt.when + kConfirms + kHeartbeat + 3 * record.limits.cycle);
  constexpr Duration kListens = std::chrono::milliseconds{180};
  for (const Fault& f : record.faults) {
    const bool begins = f.kind == FaultKind::bridge_restarted && f.until >= nmt.when;
    if (begins && f.when <= reach.until) {
      reach.until = f.until + kListens + kConfirms + kHeartbeat + 3 * record.limits.cycle;
    }
  }
  return reach;
}

void permit_nmt(const Record& record, std::size_t wheel, Permission& permission) {
  for (const Fault& fault : record.faults) {
    if (fault.kind != FaultKind::nmt) continue;
    const Interval reach = nmt_reach(record, fault, wheel);
    permission.add(reach.from, reach.until);
  }
}

Twist twist_of(const WheelSample& w, const Limits& limits) {
  return {(w.rim_mps[0] + w.rim_mps[1]) / 2.0, (w.rim_mps[1] - w.rim_mps[0]) / limits.track_m};
}

double fastest(const WheelSample& w) {
  return std::max(std::abs(w.rim_mps[0]), std::abs(w.rim_mps[1]));
}

/// Wheels without power turn: no bridge can brake them. That the bridge itself has not taken the
/// power is power_cut_while_turning()'s.
bool coasts(const WheelSample& w) {
  for (std::size_t i = 0; i < 2; ++i) {
    if (!w.powered[i] && std::abs(w.rim_mps[i]) >= kStands_mps / 4.0) return true;
  }
  return false;
}

/// Nor can it brake with brakes that do not act.
bool brakes_are_weak(const Record& record, Instant when) {
  constexpr Duration kLate = std::chrono::milliseconds{500};
  return std::any_of(record.faults.begin(), record.faults.end(), [&](const Fault& f) {
    return f.kind == FaultKind::weak_brake && f.when <= when && when <= f.until + kLate;
  });
}

/// While neither the bridge nor the drives' brakes have a hold on the wheels.
void permit_physics(const Record& record, Permission& permission) {
  constexpr Duration kSample = std::chrono::milliseconds{20};
  for (const WheelSample& w : record.wheels) {
    if (coasts(w) || brakes_are_weak(record, w.when)) permission.add(w.when, w.when + kSample);
  }
}

/// How far and until when a vehicle may go on whose brakes are called for at `from.when`: it goes
/// on accelerating for `lag`, then brakes at the rates that the bridge or the drives have.
struct Braking {
  Instant brakes;  ///< from here on
  Instant stands;
  double way_m;
};
Braking braking(const WheelSample& from, const Limits& limits, Duration lag) {
  const double lag_s = to_seconds(lag);
  const Twist u = twist_of(from, limits);
  const double v = std::abs(u.v_mps) + limits.acceleration_mps2 * lag_s;
  const double w = std::abs(u.omega_radps) + limits.yaw_acceleration_radps2 * lag_s;
  const double rim = v + w * limits.track_m / 2.0;
  const double a = std::min(limits.deceleration_mps2, kQuickStop_mps2);
  const double time_s =
      std::max({v / a, w / limits.yaw_deceleration_radps2, rim / kQuickStop_mps2});
  return {from.when + lag, from.when + lag + from_seconds(time_s), v * lag_s + v * v / (2.0 * a)};
}

/// The wheels stand outside what is permitted, but for the time and way of braking after it.
std::optional<Violation> turns_outside(const Record& record, Permission& permission, Duration lag) {
  const auto& permitted = permission.sorted();
  auto next = permitted.begin();
  Braking limit{kStart, kStart, 0.0};
  bool inside = false;
  double way_m = 0.0;
  Instant before = kStart;
  for (const WheelSample& w : record.wheels) {
    while (next != permitted.end() && next->until < w.when) {
      ++next;
      inside = true;  // it was, since the last sample
    }
    const double dt = to_seconds(w.when - std::exchange(before, w.when));
    if (next != permitted.end() && next->from <= w.when) {
      inside = true;
      continue;
    }
    if (std::exchange(inside, false)) {
      limit = braking(w, record.limits, lag);
      way_m = 0.0;
      continue;
    }
    way_m += std::abs(twist_of(w, record.limits).v_mps) * dt;
    if (fastest(w) < kStands_mps) {
      if (w.when >= limit.brakes) limit.stands = std::min(limit.stands, w.when);
    } else if (w.when > limit.stands) {
      return Violation{w.when, fmt::format("{:.3f} m/s, {:.3f} s after they should stand",
                                           fastest(w), to_seconds(w.when - limit.stands))};
    } else if (way_m > limit.way_m) {
      return Violation{
          w.when, fmt::format("{:.3f} m of way, {:.3f} m are enough to stop", way_m, limit.way_m)};
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<Violation> wheels_turn_unarmed(const Record& record) {
  Permission permission;
  for (std::size_t i = 0; i + 1 < record.states.size(); ++i) {
    if (record.states[i].state != drivetrain_state_t::ARMED) continue;
    permission.add(record.states[i].when, record.states[i + 1].when);
  }
  permit_unknown_senders(record, permission);
  permit_intruder_alone(record, permission);
  permit_silence(record, permission);
  permit_physics(record, permission);
  for (const std::size_t wheel : {0, 1}) permit_nmt(record, wheel, permission);
  return turns_outside(record, permission, reaction(record.limits));
}

std::optional<Violation> wheels_turn_on_old_commands(const Record& record) {
  Permission permission;
  Freshness fresh;
  for (const CommandSample& c : record.commands) {
    fresh.add(c);
    permission.add(c.when, fresh.as_of(record.limits.max_blind) + record.limits.stale);
  }
  permit_unknown_senders(record, permission);
  permit_intruder_alone(record, permission);
  permit_silence(record, permission);
  permit_physics(record, permission);
  return turns_outside(record, permission, reaction(record.limits));
}

std::optional<Violation> wheel_turns_without_setpoints(const Record& record) {
  for (std::size_t i = 0; i < 2; ++i) {
    Permission permission;
    for (const Instant t : record.heard[i]) permission.add(t, t + kDriveDeadline);
    permit_unknown_senders(record, permission);
    permit_intruder_alone(record, permission);
    permit_nmt(record, i, permission);
    permit_physics(record, permission);
    // Record of this wheel alone: the other one may have setpoints.
    Record one;
    one.limits = record.limits;
    one.wheels = record.wheels;
    for (WheelSample& w : one.wheels) w.rim_mps[1 - i] = w.rim_mps[i];
    one.limits.deceleration_mps2 = kQuickStop_mps2;
    one.limits.acceleration_mps2 = kQuickStop_mps2;
    if (auto v = turns_outside(one, permission, kServoLag)) return v;
  }
  return std::nullopt;
}

namespace {

/// Calls check(sample, seen, way since then) at each wheel sample at which only plans may move the
/// vehicle, until it returns a violation. `seen`: the newest pose of any plan so far.
template <class Check>
std::optional<Violation> on_plans(const Record& record, const Check& check) {
  const Limits& limits = record.limits;
  std::vector<std::pair<Instant, double>> ways;  // by the end of each sample
  std::size_t at_seen = 0;
  Instant seen = Instant::min(), others = Instant::min();
  auto command = record.commands.begin();
  auto foreign = record.foreign.begin();
  double way_m = 0.0;
  Instant before = kStart;
  for (const WheelSample& w : record.wheels) {
    way_m += std::abs(twist_of(w, limits).v_mps) * to_seconds(w.when - before);
    before = w.when;
    ways.emplace_back(w.when, way_m);
    for (; command != record.commands.end() && command->when <= w.when; ++command) {
      if (command->plan) seen = std::max(seen, command->seen);
      if (!command->plan) others = std::max(others, braking(w, limits, limits.stale * 2).stands);
    }
    for (; foreign != record.foreign.end() && *foreign <= w.when; ++foreign) {
      others = std::max(others, braking(w, limits, reaction(limits)).stands);
    }
    if (coasts(w) || brakes_are_weak(record, w.when)) {
      others = std::max(others, braking(w, limits, reaction(limits)).stands);
    }
    while (at_seen + 1 < ways.size() && ways[at_seen + 1].first <= seen) ++at_seen;
    if (seen == Instant::min() || seen < others) continue;
    if (auto v = check(w, seen, way_m - ways[at_seen].second)) return v;
  }
  return std::nullopt;
}

/// Whether odometry cannot know the way: "by odometry" is what the budget promises.
bool odometry_lies(const Record& record, Instant from, Instant until) {
  return std::any_of(record.faults.begin(), record.faults.end(), [&](const Fault& f) {
    const bool lies = f.kind == FaultKind::encoder_freeze || f.kind == FaultKind::wheel_slip;
    return lies && f.when <= until && f.until + kServoLag >= from;
  });
}

}  // namespace

std::optional<Violation> blind_for_too_long(const Record& record) {
  return on_plans(record, [&](const WheelSample& w, Instant seen, double) {
    const Duration blind = w.when - seen;
    if (blind <= record.limits.max_blind + kServoLag || fastest(w) < kStands_mps) {
      return std::optional<Violation>{};
    }
    return std::optional(
        Violation{w.when, fmt::format("{:.3f} m/s, unseen for {:.3f} s of {:.3f}", fastest(w),
                                      to_seconds(blind), to_seconds(record.limits.max_blind))});
  });
}

std::optional<Violation> blind_too_far(const Record& record) {
  return on_plans(record, [&](const WheelSample& w, Instant seen, double way_m) {
    const double most_m = record.limits.max_blind_m;
    if (way_m <= most_m || odometry_lies(record, seen, w.when)) return std::optional<Violation>{};
    return std::optional(Violation{w.when, fmt::format("{:.3f} m of {:.3f} m since t = {:.3f}",
                                                       way_m, most_m, to_seconds(seen))});
  });
}

std::optional<Violation> no_rest_at_the_end(const Record& record) {
  constexpr Duration kRest = std::chrono::milliseconds{500};
  for (WheelSample w : record.wheels) {
    // No bridge can brake what has no power.
    for (std::size_t i = 0; i < 2; ++i) w.rim_mps[i] = w.powered[i] ? w.rim_mps[i] : 0.0;
    if (w.when < record.end - kRest || fastest(w) < 1e-3) continue;
    return Violation{w.when, fmt::format("{:.4f} m/s", fastest(w))};
  }
  for (const StateSample& s : record.states) {
    const bool off = s.state != drivetrain_state_t::ARMED &&
                     s.state != drivetrain_state_t::ARMING &&
                     s.state != drivetrain_state_t::STOPPING;
    if (s.when >= record.end - kRest && !off) {
      return Violation{s.when, fmt::format("still in state {}", s.state)};
    }
  }
  return std::nullopt;
}

}  // namespace tether::campaign
