#include "can_bridge/cia402/braking.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace tether::cia402 {
namespace {

using canopen::DriveState;
using std::chrono::milliseconds;

bool has_power(std::optional<DriveState> state) {
  return state == DriveState::operation_enabled || state == DriveState::quick_stop_active ||
         state == DriveState::switched_on;
}

}  // namespace

std::optional<Fault> Braking::tick(Instant now, bool stopping) {
  if (!stopping || required_mps2_ <= 0.0) {
    watches_ = {};
    return std::nullopt;
  }
  std::optional<Fault> first;
  for (std::size_t i = 0; i < watches_.size(); ++i) {
    if (auto fault = watch(i, now); fault && !first) first = std::move(fault);
  }
  return first;
}

std::optional<Fault> Braking::watch(std::size_t i, Instant now) {
  const Axis& axis = d_.axes[i];
  Watch& w = watches_[i];
  const std::optional<double> speed_radps = axis.fastest_radps(now);
  if (axis.stood()) {
    w = {};
    return std::nullopt;
  }
  // Missing feedback cannot be judged: StopAssurance sees to drives that are not heard.
  if (!speed_radps) return std::nullopt;
  if (!w.since) {
    const bool by_setpoint = d_.axes.stops_by_setpoint(i);
    begin(i, by_setpoint ? Step::setpoint : Step::quick_stop, *speed_radps, now);
  }
  w.now_radps = *speed_radps;
  const double half_radps2 = required_mps2_ / 2.0 / d_.axes.wheel_radius_m();
  const Duration braked = now - *w.since - w.grace;
  const double allowed_radps = std::max(w.from_radps - half_radps2 * to_seconds(braked), 0.0) +
                               2.0 * d_.config.standstill_radps;
  // Until brakes act, the wheel may still follow its last setpoint.
  if (braked < Duration{0}) w.from_radps = std::max(w.from_radps, std::abs(*speed_radps));
  if (braked < Duration{0} || std::abs(*speed_radps) <= allowed_radps) {
    return std::nullopt;
  }
  w.powered = has_power(axis.state());
  if (!w.powered || w.step == Step::withheld) {
    w.failed = true;
    return std::nullopt;
  }
  const Step before = w.step;
  const double from_mps = w.from_radps * d_.axes.wheel_radius_m();
  begin(i, before == Step::quick_stop ? Step::setpoint : Step::withheld, *speed_radps, now);
  ++escalations_;
  if (w.step == Step::setpoint) d_.axes.stop_by_setpoint(i);
  return Fault{fmt::format("{}: does not brake: from {:.2f} to {:.2f} m/s within {:.0f} ms of the "
                           "{}, {:.2f} m/s2 are required: check brake ramps, load and slope",
                           axis.name(), from_mps, std::abs(*speed_radps) * d_.axes.wheel_radius_m(),
                           to_milliseconds(kGrace + braked), name_of(before), required_mps2_ / 2.0),
               true};
}

void Braking::begin(std::size_t i, Step step, double speed_radps, Instant now) {
  Watch& w = watches_[i];
  w.since = now;
  w.from_radps = std::abs(speed_radps);
  w.step = step;
  w.failed = false;
  w.grace = step == Step::withheld ? watchdog_time(d_.axes[i].node()) + kGrace : kGrace;
}

Duration Braking::watchdog_time(std::uint8_t node) const {
  Duration longest{0};
  for (const WatchdogConfig& watchdog : d_.config.watchdogs) {
    if (watchdog.node == node)
      longest = std::max<Duration>(longest, milliseconds(watchdog.timeout_ms));
  }
  return longest;
}

std::string Braking::name_of(Step step) const {
  return step == Step::quick_stop ? "quick stop" : "target of zero";
}

bool Braking::withholds() const {
  return std::ranges::any_of(watches_, [](const Watch& w) { return w.step == Step::withheld; });
}

bool Braking::withholds_from(std::uint8_t node) const {
  for (std::size_t i = 0; i < watches_.size(); ++i) {
    if (watches_[i].step == Step::withheld && d_.axes[i].node() == node) return true;
  }
  return false;
}

std::string Braking::text() const {
  std::string all;
  for (std::size_t i = 0; i < watches_.size(); ++i) {
    const Watch& w = watches_[i];
    const double speed_mps = std::abs(w.now_radps) * d_.axes.wheel_radius_m();
    std::string one;
    if (w.failed && !w.powered) {
      one = fmt::format("coasts at {:.2f} m/s without power: use the hard-wired emergency stop",
                        speed_mps);
    } else if (w.failed) {
      one = fmt::format(
          "turns at {:.2f} m/s, and nothing brakes it: use the hard-wired emergency "
          "stop",
          speed_mps);
    } else if (w.step == Step::withheld) {
      one =
          "does not brake: heartbeat and setpoints are withheld, so that the drive's own watchdog "
          "stops it";
    } else if (w.step == Step::setpoint && !d_.config.stops_by_setpoint && w.since) {
      one = "is braked by a target of zero instead of the quick stop";
    }
    if (!one.empty())
      all += fmt::format("{}{}: {}", all.empty() ? "" : "; ", d_.axes[i].name(), one);
  }
  return all;
}

}  // namespace tether::cia402
