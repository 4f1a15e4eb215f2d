#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <utility>

#include "tests/campaign/rules.hpp"

namespace tether::campaign {
namespace {

using State = drivetrain_state_t;
using Request = drive_request_t;

bool may_move(std::int32_t state) { return state == State::ARMED || state == State::STOPPING; }
bool is_on(std::int32_t state) { return state == State::ARMED || state == State::ARMING; }

/// Whether the bridge was suspended at any time between.
bool stalled(const Record& record, Instant from, Instant until) {
  return std::any_of(record.stalls.begin(), record.stalls.end(), [&](const Interval& stall) {
    return stall.from <= until && stall.until >= from;
  });
}

/// Whether a request that may act came in [from, until].
bool came(const Record& record, std::int32_t request, Instant from, Instant until) {
  return std::any_of(record.requests.begin(), record.requests.end(), [&](const RequestSample& r) {
    return r.acts && r.request == request && r.when >= from && r.when <= until;
  });
}

/// The time of the state before the i-th.
Instant before(const Record& record, std::size_t i) {
  return i == 0 ? kStart : record.states[i - 1].when;
}

/// Whether the i-th state is the first of a bridge that knows nothing of what was before.
bool is_first(const Record& record, std::size_t i) {
  return std::any_of(record.restarts.begin(), record.restarts.end(), [&](Instant restart) {
    return before(record, i) < restart && restart <= record.states[i].when;
  });
}

std::optional<Violation> at(Instant when, const std::string& what) { return Violation{when, what}; }

}  // namespace

std::optional<Violation> setpoint_forbidden(const Record& record) {
  constexpr double kTiny = 1e-6;
  const Limits& limits = record.limits;
  for (const StateSample& s : record.states) {
    const double v = std::abs(s.twist.v_mps), w = std::abs(s.twist.omega_radps);
    if (!may_move(s.state) && !(v == 0.0 && w == 0.0)) {
      return at(s.when, fmt::format("{} m/s, {} rad/s in state {}", v, w, s.state));
    }
    const bool within = v <= limits.max_speed_mps + kTiny && w <= limits.max_yaw_rate_radps + kTiny;
    if (!within) return at(s.when, fmt::format("{} m/s, {} rad/s", v, w));
  }
  return std::nullopt;
}

std::optional<Violation> frame_forbidden(const Record& record) {
  auto state = record.states.begin();
  for (const SetpointSample& frame : record.setpoints) {
    // A cycle's frames leave before it tells its state, at the same time.
    while (state != record.states.end() && state->when < frame.when) ++state;
    if (!frame.moves || state == record.states.end()) continue;
    if (state->when != frame.when) return at(frame.when, "a setpoint outside any cycle");
    if (!may_move(state->state)) return at(frame.when, fmt::format("in state {}", state->state));
  }
  return std::nullopt;
}

std::optional<Violation> stop_not_obeyed(const Record& record) {
  auto state = record.states.begin();
  for (const RequestSample& r : record.requests) {
    if (r.request != Request::ESTOP && r.request != Request::DISARM) continue;
    while (state != record.states.end() && state->when <= r.when) ++state;
    if (state == record.states.end()) return std::nullopt;
    // DISARM, then ARM, both within one cycle: still no way to ARMED.
    const bool arms =
        r.request == Request::DISARM && came(record, Request::ARM, r.when, state->when);
    const bool obeyed = arms ? state->state != State::ARMED : !is_on(state->state);
    if (!obeyed) return at(state->when, fmt::format("state {} after a stop", state->state));
  }
  return std::nullopt;
}

std::optional<Violation> armed_without_request(const Record& record) {
  std::int32_t last = State::STARTING;
  for (std::size_t i = 0; i < record.states.size(); ++i) {
    const StateSample& s = record.states[i];
    if (is_first(record, i)) last = State::STARTING;
    const std::int32_t from = std::exchange(last, s.state);
    if (s.state == from) continue;
    if (s.state == State::ARMED && from != State::ARMING) {
      return at(s.when, fmt::format("ARMED from state {}", from));
    }
    if (s.state != State::ARMING) continue;
    const bool off = from == State::DISARMED || from == State::STARTING || from == State::STOPPING;
    if (!off) return at(s.when, fmt::format("ARMING from state {}", from));
    if (!came(record, Request::ARM, before(record, i), s.when)) {
      return at(s.when, "ARMING without a fresh request");
    }
  }
  return std::nullopt;
}

std::optional<Violation> armed_without_zero(const Record& record) {
  constexpr Duration kPlanSilence = std::chrono::seconds{1};
  std::int32_t last = State::STARTING;
  for (const StateSample& s : record.states) {
    if (std::exchange(last, s.state) == s.state || !is_on(s.state)) continue;
    const bool zero =
        std::any_of(record.commands.begin(), record.commands.end(), [&](const CommandSample& c) {
          const bool fresh =
              c.plan ? c.seen + record.limits.max_blind + record.limits.stale > s.when &&
                           c.when + kPlanSilence > s.when
                     : c.as_of + record.limits.stale > s.when;
          return c.when <= s.when && fresh && c.moves_from > s.when;
        });
    if (!zero) return at(s.when, "no fresh command says to stand still");
  }
  return std::nullopt;
}

std::optional<Violation> armed_on_old_commands(const Record& record) {
  Freshness fresh;
  auto command = record.commands.begin();
  for (const StateSample& s : record.states) {
    for (; command != record.commands.end() && command->when <= s.when; ++command) {
      fresh.add(*command);
    }
    const Duration age = s.when - fresh.as_of(record.limits.max_blind);
    if (s.state == State::ARMED && age > record.limits.disarm + record.limits.cycle) {
      return at(s.when,
                fmt::format("ARMED, though no command is younger than {:.3f} s", to_seconds(age)));
    }
  }
  return std::nullopt;
}

std::optional<Violation> fault_left(const Record& record) {
  std::optional<Instant> since;  // RESET counts from here on
  for (std::size_t i = 0; i < record.states.size(); ++i) {
    const StateSample& s = record.states[i];
    if (is_first(record, i)) since.reset();
    if (s.state == State::FAULT || s.state == State::UNCONFIRMED) {
      if (!since) since = before(record, i);
    } else if (since && s.state != State::ESTOP && s.state != State::STOPPING) {
      if (!came(record, Request::RESET, *since, s.when)) {
        return at(s.when, fmt::format("FAULT led to state {} without RESET", s.state));
      }
      since.reset();
    }
  }
  return std::nullopt;
}

namespace {

/// The e-stop as requests leave it.
struct EstopLatch {
  bool pressed = false;
  bool latched = false;

  void on_request(const RequestSample& r) {
    if (!r.acts) return;
    if (r.request == Request::ESTOP) pressed = latched = true;
    if (r.request == Request::ESTOP_RELEASE) pressed = false;
    if (r.request == Request::RESET && !pressed) latched = false;
  }
};

}  // namespace

std::optional<Violation> estop_left(const Record& record) {
  EstopLatch estop;
  auto request = record.requests.begin();
  for (std::size_t i = 0; i < record.states.size(); ++i) {
    const StateSample& s = record.states[i];
    // The old bridge had no time to store requests that it received after its last cycle.
    if (is_first(record, i)) {
      while (request != record.requests.end() && request->when < record.restarts.front()) ++request;
      if (estop.latched) estop.pressed = true;
    }
    for (; request != record.requests.end() && request->when < s.when; ++request) {
      estop.on_request(*request);
    }
    if (!estop.latched || s.state == State::ESTOP || s.state == State::STOPPING) continue;
    // A request at the very time of this cycle may have come before it.
    for (auto r = request; r != record.requests.end() && r->when == s.when; ++r) {
      estop.on_request(*r);
      if (!estop.latched) break;
    }
    if (estop.latched) return at(s.when, fmt::format("e-stop led to state {}", s.state));
  }
  return std::nullopt;
}

namespace {

/// Whether the drive that has this fault cannot tell: it is silent, or its firmware does not run,
/// or it reboots before its next report.
bool is_silent(const Record& record, const Fault& fault) {
  constexpr Duration kBoots = std::chrono::milliseconds{300};
  if (fault.kind != FaultKind::drive_fault) return false;
  return std::any_of(record.faults.begin(), record.faults.end(), [&](const Fault& f) {
    const bool silent = f.kind == FaultKind::drive_silent && fault.when <= f.until;
    const bool boots = f.kind == FaultKind::drive_reboot && fault.when <= f.when + kBoots;
    return (silent || boots) && f.node == fault.node && f.when <= fault.when + record.limits.cycle;
  });
}

}  // namespace

std::optional<Violation> fault_unnoticed(const Record& record) {
  // docs/reference/drivetrain.md: 20 ms for a fault, 100 ms for missing feedback; and two cycles.
  for (const Fault& fault : record.faults) {
    Duration within{};
    const Duration missing = std::chrono::milliseconds{100} + 2 * record.limits.cycle;
    switch (fault.kind) {
      case FaultKind::drive_fault:
      case FaultKind::bus_off:
      case FaultKind::bus_stalled:
      case FaultKind::bus_down:
        within = is_silent(record, fault) ? missing
                                          : std::chrono::milliseconds{20} + 2 * record.limits.cycle;
        break;
      case FaultKind::drive_reboot:
      case FaultKind::drive_silent:
        within = missing;
        break;
      default:
        continue;
    }
    if (fault.kind == FaultKind::drive_silent && fault.until - fault.when < within) continue;
    const Instant due = fault.when + within;
    if (due > record.end || stalled(record, fault.when, due)) continue;
    const bool noticed =
        std::any_of(record.states.begin(), record.states.end(), [&](const StateSample& s) {
          return s.when >= fault.when && s.when <= due && s.state != State::ARMED;
        });
    if (!noticed) return at(due, fmt::format("still ARMED: {}", row_of(fault.kind).name));
  }
  return std::nullopt;
}

std::optional<Violation> frozen_encoder_unnoticed(const Record& record) {
  // docs/reference/drivetrain.md: frozen at 0.3 m/s after 1.3 s; and a tenth for the setpoint's way
  // to it.
  constexpr double kSlow_mps = 0.3;
  constexpr Duration kNoticed = std::chrono::milliseconds{1400};
  for (const Fault& fault : record.faults) {
    if (fault.kind != FaultKind::encoder_freeze) continue;
    Instant since = Instant::max();
    const double side = fault.node == 1 ? -0.5 : 0.5;
    for (const StateSample& s : record.states) {
      if (s.when < fault.when || s.when > fault.until) continue;
      const double rim = s.twist.v_mps + side * record.limits.track_m * s.twist.omega_radps;
      if (s.state != State::ARMED || std::abs(rim) < kSlow_mps) {
        since = Instant::max();
      } else if (since == Instant::max()) {
        since = s.when;
      }
      if (since < s.when && s.when - since > kNoticed) {
        return at(s.when, fmt::format("ARMED at {:.2f} m/s, frozen for {:.2f} s", rim,
                                      to_seconds(s.when - fault.when)));
      }
    }
  }
  return std::nullopt;
}

}  // namespace tether::campaign
