#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "can_bridge/cia402/config.hpp"
#include "can_bridge/commission/commission.hpp"

// Results of the trials of a Commission, and their verdict.

namespace tether {
namespace {

std::optional<double> configured_quick_stop_mps2(const Cia402Config& config, std::size_t axis,
                                                 double wheel_radius_m) {
  const AxisConfig& wheel = config.axes[axis];
  for (const SetupWrite& write : config.setup) {
    if (write.node != wheel.node || write.object.index != 0x6085) continue;
    return static_cast<double>(write.value) / wheel.target_velocity_per_rps.value() * 2.0 *
           std::numbers::pi * wheel_radius_m;
  }
  return std::nullopt;
}

bool watches_heartbeat(const Cia402Config& config, std::uint8_t node) {
  return std::ranges::any_of(config.watchdogs, [node](const WatchdogConfig& watchdog) {
    return watchdog.node == node && watchdog.kind == WatchdogConfig::Kind::heartbeat_consumer;
  });
}

std::string watchdog_text(const Cia402Config& config, std::uint8_t node) {
  std::string all;
  for (const WatchdogConfig& watchdog : config.watchdogs) {
    if (watchdog.node != node) continue;
    all += (all.empty() ? "" : ", ") + cia402::object_text(watchdog.object);
    if (watchdog.reaction) all += ", " + cia402::object_text(*watchdog.reaction);
  }
  return all;
}

std::string percent_apart(double is, double of) {
  return of == 0.0 ? "not comparable" : fmt::format("{:+.0f} %", 100.0 * (is / of - 1.0));
}

bool is_apart(double is, double of) {
  return !(std::abs(is - of) <= Commission::kMostApart * std::abs(of));
}

}  // namespace

void Commission::judge_feedback(Instant now) {
  const double span_s = to_seconds(now - steady_->stamp);
  const double wanted_mps = direction() * options_.speed_mps;
  bool wrong = false;
  for (std::size_t i = 0; i < 2; ++i) {
    const double speed_mps = (integral_m_[i] - steady_->speed_integral_m[i]) / span_s;
    const std::string found =
        fmt::format("{:.3f} m/s by position, {:.3f} m/s by velocity, at a setpoint of {:.3f} m/s",
                    steady_mps_[i], speed_mps, wanted_mps);
    std::string problem;
    if (is_apart(steady_mps_[i], wanted_mps) && is_apart(speed_mps, wanted_mps)) {
      problem = fmt::format(
          "position ({}) and velocity ({}) do not agree with the setpoint: check sign, "
          "target_velocity_per_rps, and whether the wheel turns",
          percent_apart(steady_mps_[i], wanted_mps), percent_apart(speed_mps, wanted_mps));
    } else if (is_apart(steady_mps_[i], wanted_mps)) {
      problem = fmt::format(
          "position does not agree with the setpoint ({}): check "
          "counts_per_revolution and the encoder",
          percent_apart(steady_mps_[i], wanted_mps));
    } else if (is_apart(speed_mps, wanted_mps)) {
      problem = fmt::format(
          "velocity does not agree with the setpoint ({}): check "
          "actual_velocity_per_rps and 0x606C",
          percent_apart(speed_mps, wanted_mps));
    }
    wrong = wrong || !problem.empty();
    add(i, found, problem);
  }
  if (wrong) fail("the feedback is wrong: nothing else was tried", now);
}

void Commission::judge_quick_stop(Instant now) {
  for (std::size_t i = 0; i < 2; ++i) {
    const double v = std::abs(steady_mps_[i]);
    if (!stood_[i]) {
      add(i, fmt::format("still turns after {:.0f} s", to_seconds(kMostWait)),
          "the quick stop does not stop it: check 0x605A and 0x6085");
      continue;
    }
    // The setpoint before acts until the SYNC of this cycle.
    const double way = std::abs(way_m(i) - steady_->way_m[i]);
    const double braking = std::max(way - v * to_seconds(options_.cycle), 0.001);
    const double mps2 = v * v / (2.0 * braking);
    const auto configured = configured_quick_stop_mps2(config_, i, vehicle_.wheel_radius_m);
    std::string problem;
    if (options_.wheels_free && configured && mps2 < *configured / 2.0) {
      problem = fmt::format(
          "brakes with {:.2f} m/s², less than half of the configured {:.2f} m/s² (0x6085)", mps2,
          *configured);
    }
    add(i,
        fmt::format("stands after {:.2f} s and {:.3f} m from {:.3f} m/s: at least {:.2f} m/s²",
                    to_seconds(*stood_[i] - since_), way, v, mps2),
        problem);
  }
  enter(Step::stopping, now);
}

bool Commission::must_stop(std::size_t axis) const {
  const std::uint8_t node = config_.axes[axis].node;
  switch (trial()) {
    case Trial::silence:
      return true;
    case Trial::heartbeat:
      return watches_heartbeat(config_, node);
    case Trial::setpoints:
      return std::ranges::any_of(config_.pdos, [node](const PdoConfig& pdo) {
        return pdo.node == node && !pdo.transmit && pdo.event_timer_ms > 0 &&
               pdo.event_timer_required;
      });
    case Trial::sync:
      return reports_[axis] && waits_for_sync(node);
    default:
      return false;
  }
}

/// Its setpoints, and so its stops by PDO, act at SYNC.
bool Commission::waits_for_sync(std::uint8_t node) const {
  constexpr int kLastSynchronous = 240;
  return config_.sync && std::ranges::any_of(config_.pdos, [node](const PdoConfig& pdo) {
           return pdo.node == node && !pdo.transmit && pdo.transmission <= kLastSynchronous;
         });
}

// It has no heartbeat consumer, so that its watchdog is a vendor's.
bool Commission::hears_any_frame(std::size_t axis) const {
  return trial() == Trial::silence && !watches_heartbeat(config_, config_.axes[axis].node);
}

void Commission::judge_withheld(Instant now) {
  for (std::size_t i = 0; i < polls_.size(); ++i) {
    const double way = std::abs(polls_[i].way_m());
    if (stood_[i]) {
      const double after_s = std::max(0.0, to_seconds(*stood_[i] - since_));
      add(i,
          hears_any_frame(i)
              ? fmt::format("stood when it was asked, after {:.1f} s", to_seconds(kQuiet))
              : fmt::format("stands after {:.2f} s and {:.3f} m", after_s, way),
          "");
      continue;
    }
    const std::string found =
        fmt::format("drives on: {:.3f} m in {:.1f} s", way, to_seconds(elapsed(now)));
    std::string problem;
    if (trial() == Trial::sync && must_stop(i)) {
      problem =
          "SYNC withheld: it drives on and reports as before, so that the bridge would not notice, "
          "and its "
          "setpoints act at SYNC: let its TPDOs depend on SYNC (0x1800:2 = 1)";
    } else if (must_stop(i)) {
      problem = fmt::format(
          "{}: it drives on, its watchdog does not act ({}): check in its manual what that needs",
          trial_name(trial()),
          trial() == Trial::setpoints ? "0x1400:5" : watchdog_text(config_, config_.axes[i].node));
    }
    add(i, found, problem);
  }
}

void Commission::add(std::size_t axis, const std::string& found, const std::string& problem) {
  record_.results.push_back(
      {cia402::axis_name(config_, axis), trial_name(trial()), found, problem});
}

}  // namespace tether
