#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <tether/drivetrain_state_t.hpp>
#include <utility>

#include "tests/campaign/rules.hpp"

// The bridge's knowledge of the wheels, against their true motion.

namespace tether::campaign {
namespace {

using State = drivetrain_state_t;

/// Standstill of drivetrains/two_node_cia402.toml is 0.02 m/s; and what a push or a servo's lag may
/// add within the two cycles from feedback to frame.
constexpr double kTurns_mps = 0.05;
/// A load pushes at up to 2 m/s²; the bridge knows of standstill up to three cycles before.
constexpr double kPushed_mps = kTurns_mps + 2.0 * 0.06;
/// An unknown sender may switch a drive on after it said that it is off.
constexpr Duration kForeignReach = std::chrono::milliseconds{100};
/// From a fault of an encoder on, until the bridge can have discarded its reports.
constexpr Duration kRecovers = std::chrono::milliseconds{300};

/// Since when this wheel has turned without a pause; `when` if it stands then.
Instant turning_since(const Record& record, std::size_t wheel, Instant when) {
  constexpr double kStands_mps = 0.02;
  Instant since = when;
  auto w = std::upper_bound(record.wheels.begin(), record.wheels.end(), when,
                            [](Instant t, const WheelSample& s) { return t < s.when; });
  while (w != record.wheels.begin() && std::abs((--w)->rim_mps[wheel]) > kStands_mps) {
    since = w->when;
  }
  return since;
}

/// Whether something moved this wheel against setpoints and ramps, or took its power, within the
/// last seconds or since it began to turn: only witnesses can know of that.
bool is_moved_unasked(const Record& record, std::size_t wheel, Instant when) {
  const Duration rolls_out =
      std::max<Duration>(std::chrono::seconds{5}, when - turning_since(record, wheel, when));
  return std::any_of(record.faults.begin(), record.faults.end(), [&](const Fault& f) {
    constexpr FaultKind kMoves[] = {FaultKind::pushed,        FaultKind::weak_brake,
                                    FaultKind::drive_reboot,  FaultKind::bridge_restarted,
                                    FaultKind::nmt,           FaultKind::sdo_write,
                                    FaultKind::foreign_master};
    const bool moves = std::find(std::begin(kMoves), std::end(kMoves), f.kind) != std::end(kMoves);
    return moves && f.when <= when && when <= f.until + rolls_out;
  });
}

/// Whether nothing can be known of this wheel: a silent drive has no witness; and of a wheel whose
/// encoder, which serves both witnesses, fails, the setpoint tells only what the bridge did.
bool is_blind(const Record& record, std::size_t wheel, Instant when) {
  return std::any_of(record.faults.begin(), record.faults.end(), [&](const Fault& f) {
    const bool lies = f.kind == FaultKind::encoder_freeze || f.kind == FaultKind::wheel_slip;
    const bool unknown =
        f.kind == FaultKind::drive_silent || (lies && is_moved_unasked(record, wheel, when));
    return unknown && f.node == static_cast<int>(wheel) + 1 && f.when <= when &&
           f.until + kRecovers >= when;
  });
}

bool is_pushed(const Record& record, Instant when) {
  return std::any_of(record.faults.begin(), record.faults.end(), [&](const Fault& f) {
    return f.kind == FaultKind::pushed && f.when <= when && when <= f.until + kForeignReach;
  });
}

bool is_commanded_by_others(const Record& record, Instant when) {
  return std::any_of(record.foreign.begin(), record.foreign.end(),
                     [&](Instant t) { return t <= when && when <= t + kForeignReach; });
}

double most_mps(const Record& record, Instant when) {
  return is_pushed(record, when) ? kPushed_mps : kTurns_mps;
}

/// Whether anything but the bridge moves wheels, or keeps its setpoints from them.
bool is_disturbed(const Record& record, Instant when) {
  constexpr Duration kReach = std::chrono::milliseconds{500};
  const bool by_frames = std::any_of(record.foreign.begin(), record.foreign.end(),
                                     [&](Instant t) { return t <= when && when <= t + kReach; });
  return by_frames || std::any_of(record.faults.begin(), record.faults.end(), [&](const Fault& f) {
           return f.kind >= FaultKind::bridge_stalls && f.when <= when && when <= f.until + kReach;
         });
}

double rim_told(const Twist& u, std::size_t wheel, const Limits& limits) {
  return u.v_mps + (wheel == 0 ? -0.5 : 0.5) * limits.track_m * u.omega_radps;
}

}  // namespace

std::optional<Violation> power_cut_while_turning(const Record& record) {
  for (const CutSample& cut : record.cuts) {
    if (std::abs(cut.rim_mps) <= most_mps(record, cut.when)) continue;
    if (is_blind(record, cut.wheel, cut.when)) continue;
    if (!cut.reset && is_commanded_by_others(record, cut.when)) continue;
    return Violation{cut.when,
                     fmt::format("{} wheel at {:.3f} m/s: {}", cut.wheel == 0 ? "left" : "right",
                                 cut.rim_mps, cut.reset ? "reset" : "power cut")};
  }
  return std::nullopt;
}

std::optional<Violation> standstill_reported_while_turning(const Record& record) {
  auto wheels = record.wheels.begin();
  std::int32_t last = State::STARTING;
  for (const StateSample& s : record.states) {
    while (wheels + 1 != record.wheels.end() && (wheels + 1)->when <= s.when) ++wheels;
    const std::int32_t before = std::exchange(last, s.state);
    const bool claims = s.state == State::ARMED || s.state == State::DISARMED;
    if (!claims || s.state == before || record.wheels.empty()) continue;
    for (std::size_t i = 0; i < 2; ++i) {
      const double rim_mps = wheels->rim_mps[i];
      if (std::abs(rim_mps) <= most_mps(record, s.when) || is_blind(record, i, s.when)) continue;
      return Violation{s.when, fmt::format("{:.3f} m/s, and state {}", rim_mps, s.state)};
    }
  }
  return std::nullopt;
}

std::optional<Violation> armed_wheel_not_as_told(const Record& record) {
  constexpr Duration kLag = std::chrono::milliseconds{300};
  constexpr double kWithin_mps = 0.2;
  std::size_t first = 0, next = 0;  // setpoints of the last kLag
  for (const WheelSample& w : record.wheels) {
    while (next < record.states.size() && record.states[next].when <= w.when) ++next;
    while (first < next && record.states[first].when < w.when - kLag) ++first;
    if (first == next || record.states[next - 1].state != State::ARMED) continue;
    for (std::size_t i = 0; i < 2; ++i) {
      double low = 1e9, high = -1e9;
      for (std::size_t k = first; k < next; ++k) {
        const double told = rim_told(record.states[k].twist, i, record.limits);
        low = std::min(low, told);
        high = std::max(high, told);
      }
      const bool within = w.rim_mps[i] >= low - kWithin_mps && w.rim_mps[i] <= high + kWithin_mps;
      if (within || is_disturbed(record, w.when)) continue;
      return Violation{w.when,
                       fmt::format("{:.3f} m/s, told {:.3f} to {:.3f}", w.rim_mps[i], low, high)};
    }
  }
  return std::nullopt;
}

}  // namespace tether::campaign
