#include "can_bridge/cia402/checks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string_view>
#include <utility>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/stop_objects.hpp"
#include "common/base/errors.hpp"

namespace tether {
namespace {

constexpr std::array<const char*, 2> kSides{"left", "right"};

/// An axis' object that travels in PDOs.
struct Carried {
  const char* name;
  ObjectRef AxisConfig::*object;
  bool transmit;  ///< in a TPDO
};
constexpr std::array<Carried, 5> kCarried{{
    {"controlword", &AxisConfig::controlword, false},
    {"target_velocity", &AxisConfig::target_velocity, false},
    {"statusword", &AxisConfig::statusword, true},
    {"actual_velocity", &AxisConfig::actual_velocity, true},
    {"actual_position", &AxisConfig::actual_position, true},
}};

bool is_synchronous(const PdoConfig& pdo) { return pdo.transmission <= 240; }

class Checker {
 public:
  Checker(const Cia402Config& config, const Cia402Source& source) : c_(config), source_(source) {}

  void run() const {
    check_nodes();
    check_times();
    check_warnings();
    check_shared_objects();
    for (std::size_t i = 0; i < c_.pdos.size(); ++i) check_pdo(i);
    for (std::size_t side = 0; side < 2; ++side) check_coverage(side);
    for (std::size_t i = 0; i < c_.setup.size(); ++i) check_setup(i);
    check_watchdogs();
    for (std::size_t side = 0; side < 2; ++side) check_stop(side);
  }

 private:
  [[noreturn]] void refuse(std::uint32_t line, const std::string& message) const {
    throw UsageError(fmt::format("{}:{}: {}", source_.file, line, message));
  }

  void check_nodes() const {
    for (std::size_t side = 0; side < 2; ++side) {
      if (c_.axes[side].node == c_.master_node) {
        refuse(source_.axis_lines[side],
               fmt::format("{}.node = {} is the bridge's own (bridge.node): each participant needs "
                           "a node id of its own",
                           kSides[side], c_.master_node));
      }
    }
  }

  void check_times() const {
    if (c_.drive_heartbeat_timeout_ms < 3 * c_.drive_heartbeat_ms) {
      refuse(source_.drives_line,
             fmt::format("drives.heartbeat_timeout_ms = {} is not allowed: must be at least {}, "
                         "three times drives.heartbeat_ms, or one lost frame stops the vehicle",
                         c_.drive_heartbeat_timeout_ms, 3 * c_.drive_heartbeat_ms));
    }
  }

  void check_warnings() const {
    for (const std::uint16_t code : {canopen::kEmcyHeartbeat, canopen::kEmcyRpdoTimeout}) {
      if (!c_.is_warning(code)) continue;
      refuse(source_.drives_line,
             fmt::format("drives.emcy_warnings has {}: a drive that says so stops by itself, which "
                         "is no warning",
                         cia402::error_text(code)));
    }
  }

  /// Axes on one node must be distinguishable by their commands and by their reports.
  void check_shared_objects() const {
    const AxisConfig& left = c_.axes[0];
    const AxisConfig& right = c_.axes[1];
    for (std::size_t side = 0; side < 2; ++side) {
      const AxisConfig& axis = c_.axes[side];
      if (axis.statusword_shift + 16 > 8 * axis.statusword.bytes) {
        refuse(source_.axis_lines[side],
               fmt::format("{}.statusword_shift = {} is not allowed: {} has no 16 bits from there",
                           kSides[side], axis.statusword_shift, to_string(axis.statusword)));
      }
    }
    if (left.node != right.node) return;
    const auto differ = [&](const char* name, const ObjectRef& a, const ObjectRef& b) {
      if (!same_object(a, b)) return;
      refuse(source_.axis_lines[1],
             fmt::format("left and right are both on node {} and have the same {}, {}: axes of one "
                         "node may share only controlword, mode, mode_display, error_code and the "
                         "halves of a statusword",
                         left.node, name, to_string(a)));
    };
    differ("target_velocity", left.target_velocity, right.target_velocity);
    differ("actual_velocity", left.actual_velocity, right.actual_velocity);
    differ("actual_position", left.actual_position, right.actual_position);
    if (left.statusword_shift == right.statusword_shift) {
      differ("statusword", left.statusword, right.statusword);
    }
  }

  void check_pdo(std::size_t i) const {
    const PdoConfig& pdo = c_.pdos[i];
    const std::uint32_t line = source_.pdo_lines[i];
    const std::string name = fmt::format("{} of node {}", cia402::pdo_name(pdo), pdo.node);
    int bytes = 0;
    for (const ObjectRef& object : pdo.objects) bytes += object.bytes;
    if (bytes > 8) {
      refuse(line,
             fmt::format("{} has {} bytes of objects: a CAN frame carries at most 8", name, bytes));
    }
    for (std::size_t j = 0; j < i; ++j) {
      const PdoConfig& other = c_.pdos[j];
      if (other.node == pdo.node && other.number == pdo.number && other.transmit == pdo.transmit) {
        refuse(line,
               fmt::format("{} is described twice, first in line {}", name, source_.pdo_lines[j]));
      }
    }
    if (is_synchronous(pdo) && !c_.sync) {
      refuse(line,
             fmt::format("{} has transmission = {}, but bridge.sync = false: the bridge sends no "
                         "SYNC (use 254 or 255)",
                         name, pdo.transmission));
    }
    if (pdo.event_timer_required && pdo.event_timer_ms == 0) {
      refuse(line, fmt::format("{} has event_timer_required without event_timer_ms", name));
    }
    pdo.transmit ? check_tpdo(pdo, name, line) : check_rpdo(pdo, name, line);
  }

  void check_tpdo(const PdoConfig& pdo, const std::string& name, std::uint32_t line) const {
    if (is_synchronous(pdo)) return;
    if (pdo.event_timer_ms == 0) {
      refuse(line, fmt::format("{} is sent only when something changes, and silence would look "
                               "like a dead drive: give event_timer_ms, or transmission = 1",
                               name));
    }
    if (2 * pdo.event_timer_ms > c_.feedback_timeout_ms) {
      refuse(line, fmt::format("{} has event_timer_ms = {}: must be at most {}, half of "
                               "drives.feedback_timeout_ms, or one lost frame stops the vehicle",
                               name, pdo.event_timer_ms, c_.feedback_timeout_ms / 2));
    }
  }

  void check_rpdo(const PdoConfig& pdo, const std::string& name, std::uint32_t line) const {
    for (const ObjectRef& object : pdo.objects) {
      const bool known = std::any_of(c_.axes.begin(), c_.axes.end(), [&](const AxisConfig& axis) {
        return axis.node == pdo.node &&
               (axis.controlword == object || axis.target_velocity == object);
      });
      if (!known) {
        refuse(line, fmt::format("{} carries {}, for which the bridge has no value: RPDOs may "
                                 "carry controlword and target_velocity of an axis of their node",
                                 name, to_string(object)));
      }
    }
  }

  void check_coverage(std::size_t side) const {
    const AxisConfig& axis = c_.axes[side];
    for (const Carried& value : kCarried) {
      const ObjectRef& object = axis.*value.object;
      const bool carried = std::any_of(c_.pdos.begin(), c_.pdos.end(), [&](const PdoConfig& pdo) {
        return pdo.node == axis.node && pdo.transmit == value.transmit &&
               std::find(pdo.objects.begin(), pdo.objects.end(), object) != pdo.objects.end();
      });
      if (carried) continue;
      refuse(source_.axis_lines[side],
             fmt::format("no {} of node {} carries {}.{} ({})", value.transmit ? "TPDO" : "RPDO",
                         axis.node, kSides[side], value.name, to_string(object)));
    }
  }

  void check_setup(std::size_t i) const {
    const SetupWrite& write = c_.setup[i];
    const std::uint32_t line = source_.setup_lines[i];
    const auto refuse_object = [&](std::string_view why) {
      refuse(line,
             fmt::format("setup of {} on node {}: {}", to_string(write.object), write.node, why));
    };
    for (std::size_t j = 0; j < i; ++j) {
      if (c_.setup[j].node == write.node && same_object(c_.setup[j].object, write.object)) {
        refuse_object(fmt::format("is there twice, first in line {}", source_.setup_lines[j]));
      }
    }
    if (canopen::is_pdo_parameter(write.object.index)) {
      refuse_object("PDO parameters are described in [[pdo]]");
    }
    if (write.object.index == 0x1017) refuse_object("is written from drives.heartbeat_ms");
    for (const WatchdogConfig& watchdog : c_.watchdogs) {
      if (watchdog.node == write.node && same_object(watchdog.object, write.object)) {
        refuse_object("is written from [[watchdog]]");
      }
      if (watchdog.node == write.node && watchdog.reaction &&
          same_object(*watchdog.reaction, write.object)) {
        refuse_object("is written from watchdog.reaction");
      }
    }
    if (is_no_reaction(write.object, write.value)) {
      refuse_object(
          "value = 0 means that the drive runs on when the bridge is lost (1 fault, 2 "
          "power off, 3 quick stop)");
    }
    for (const AxisConfig& axis : c_.axes) {
      if (axis.node != write.node) continue;
      for (const ObjectRef& live : {axis.controlword, axis.target_velocity, axis.mode}) {
        if (same_object(live, write.object)) {
          refuse_object("the bridge itself writes it while it runs");
        }
      }
    }
  }

  void check_stop(std::size_t side) const {
    const std::uint32_t line = source_.axis_lines[side];
    const auto option = cia402::quick_stop_option(c_, side);
    const bool has_ramp = std::isfinite(cia402::stop_ramp_radps2(c_, side));
    if (c_.stops_by_setpoint) return;
    constexpr const char* kAdvice =
        "write it in [[setup]], or give drives.stop = \"setpoint\" if the drive has no quick stop "
        "ramp";
    if (!option) {
      refuse(line, fmt::format("{} axis: no [[setup]] sets its quick stop option (0x605A): {}",
                               kSides[side], kAdvice));
    }
    if (*option != 1 && *option != 2 && *option != 5 && *option != 6) {
      refuse(line,
             fmt::format("{} axis: quick stop option (0x605A) {} does not brake by a ramp: use "
                         "2 or 6 (0x6085), or 1 or 5 (0x6084)",
                         kSides[side], *option));
    }
    if (has_ramp) return;
    refuse(line, fmt::format("{} axis: no [[setup]] sets the ramp of its quick stop (0x60{}): {}",
                             kSides[side], *option == 1 || *option == 5 ? "84" : "85", kAdvice));
  }

  void check_watchdogs() const {
    for (std::size_t i = 0; i < c_.watchdogs.size(); ++i) {
      const WatchdogConfig& watchdog = c_.watchdogs[i];
      if (watchdog.timeout_ms < 3 * c_.heartbeat_ms) {
        refuse(source_.watchdog_lines[i],
               fmt::format("watchdog.timeout_ms = {} is not allowed: must be at least {}, three "
                           "times bridge.heartbeat_ms, or one lost frame stops the drive",
                           watchdog.timeout_ms, 3 * c_.heartbeat_ms));
      }
      for (std::size_t j = 0; j < i; ++j) {
        const WatchdogConfig& other = c_.watchdogs[j];
        if (other.node == watchdog.node && other.object == watchdog.object) {
          refuse(source_.watchdog_lines[i],
                 fmt::format("watchdog {} of node {} is there twice, first in line {}",
                             to_string(watchdog.object), watchdog.node, source_.watchdog_lines[j]));
        }
      }
    }
    for (std::size_t side = 0; side < 2; ++side) {
      const auto guards = [&](const WatchdogConfig& w) { return w.node == c_.axes[side].node; };
      if (std::any_of(c_.watchdogs.begin(), c_.watchdogs.end(), guards)) continue;
      refuse(source_.axis_lines[side],
             fmt::format("node {} ({} axis) has no [[watchdog]]: nothing would stop its wheel when "
                         "the bridge or the cable dies",
                         c_.axes[side].node, kSides[side]));
    }
  }

  const Cia402Config& c_;
  const Cia402Source& source_;
};

}  // namespace

bool is_no_reaction(const ObjectRef& object, std::int64_t value) {
  constexpr int kAbortConnectionOption = 0x6007;
  constexpr int kAxisStep = 0x800;
  constexpr int kLastOfProfile = 0x9FFF;
  return value == 0 && object.index >= kAbortConnectionOption && object.index <= kLastOfProfile &&
         (object.index - kAbortConnectionOption) % kAxisStep == 0;
}

void check_cia402(const Cia402Config& config, const Cia402Source& source) {
  Checker(config, source).run();
}

void Cia402Config::check_deceleration(double mps2, double wheel_radius_m) const {
  for (std::size_t side = 0; side < axes.size(); ++side) {
    const double ramp_mps2 = cia402::stop_ramp_radps2(*this, side) * wheel_radius_m;
    // The file's whole numbers may round down by a little.
    if (ramp_mps2 >= 0.999 * mps2) continue;
    const double needed = mps2 / wheel_radius_m / (2.0 * std::numbers::pi) *
                          axes[side].target_velocity_per_rps.value();
    throw UsageError(fmt::format(
        "drivetrain \"{}\": the {} axis stops with {:.2f} m/s2, less than "
        "can.max_deceleration_mps2 = {:g}: set its ramp (0x6085 or 0x6084) to {:.0f} at least",
        name, kSides[side], ramp_mps2, mps2, std::ceil(needed)));
  }
}

OwnStop Cia402Config::own_stop(double wheel_radius_m) const {
  double weakest_radps2 = std::numeric_limits<double>::infinity();
  bool known = true;
  int latest_ms = 0;
  for (std::size_t side = 0; side < axes.size(); ++side) {
    const double ramp_radps2 = cia402::stop_ramp_radps2(*this, side);
    known = known && std::isfinite(ramp_radps2);
    weakest_radps2 = std::min(weakest_radps2, ramp_radps2);
    int deadline_ms = std::numeric_limits<int>::max();
    for (const WatchdogConfig& watchdog : watchdogs) {
      if (watchdog.node != axes[side].node) continue;
      deadline_ms = std::min<int>(deadline_ms, watchdog.timeout_ms);
    }
    for (const PdoConfig& pdo : pdos) {
      if (pdo.transmit || pdo.node != axes[side].node || !pdo.event_timer_required) continue;
      if (std::ranges::count(pdo.objects, axes[side].target_velocity) == 0) continue;
      deadline_ms = std::min<int>(deadline_ms, pdo.event_timer_ms);
    }
    latest_ms = std::max(latest_ms, deadline_ms);
  }
  OwnStop stop{std::nullopt, std::chrono::milliseconds{latest_ms}};
  if (known) stop.mps2 = weakest_radps2 * wheel_radius_m;
  return stop;
}

void Cia402Config::check_cycle(double cycle_ms) const {
  const auto demand = [&](const char* key, double timeout_ms, double period_ms) {
    if (timeout_ms >= 3.0 * period_ms) return;
    throw UsageError(fmt::format(
        "can.cycle_ms = {:g} is not allowed with drivetrain \"{}\": {} = {:g} has to be at least "
        "three times the {:g} ms that pass between frames, or one lost frame stops the vehicle",
        cycle_ms, name, key, timeout_ms, period_ms));
  };
  const double beat_ms = std::ceil(heartbeat_ms / cycle_ms) * cycle_ms;
  for (const WatchdogConfig& watchdog : watchdogs) {
    demand("watchdog.timeout_ms", watchdog.timeout_ms, beat_ms);
  }
  demand("drives.feedback_timeout_ms", feedback_timeout_ms, cycle_ms);
  for (const PdoConfig& pdo : pdos) {
    if (!pdo.transmit && pdo.event_timer_ms != 0) {
      demand("pdo.event_timer_ms", pdo.event_timer_ms, cycle_ms);
    }
  }
}

}  // namespace tether
