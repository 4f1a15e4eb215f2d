#include "tools/can/operator.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdio>
#include <functional>
#include <numbers>
#include <optional>
#include <set>
#include <stdexcept>
#include <tether/counters_t.hpp>
#include <tether/drive_fault_t.hpp>
#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <tether/odometry_t.hpp>
#include <tether/wheel_feedback_t.hpp>

#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/message_io.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/program/cli.hpp"
#include "tools/can/twist_drive.hpp"

namespace tether {

RequestOutcome judge_request(std::int32_t request, const drivetrain_state_t& state,
                             Duration since_request) {
  using State = drivetrain_state_t;
  using enum RequestOutcome;
  const std::int32_t s = state.state;
  // A state from before the bridge had time to react says nothing.
  const RequestOutcome otherwise = since_request < kReactionTime ? pending : refused;
  switch (request) {
    case drive_request_t::ARM:
      if (s == State::ARMED) return reached;
      return s == State::ARMING ? pending : otherwise;
    case drive_request_t::DISARM:
      if (s == State::STOPPING) return pending;
      return s == State::ARMED || s == State::ARMING ? otherwise : reached;
    case drive_request_t::ESTOP:
      if (s == State::ESTOP) return reached;
      return s == State::STOPPING ? pending : otherwise;
    case drive_request_t::ESTOP_RELEASE:
      if (s != State::ESTOP || !state.reason.starts_with("e-stop pressed")) return reached;
      return otherwise;
    case drive_request_t::RESET:
      if (s == State::DISARMED) return reached;
      return s == State::STARTING ? pending : otherwise;
    default:
      assert(!"a constant of drive_request_t");
      return refused;
  }
}

namespace {

constexpr Duration kBridgeHello = std::chrono::seconds{2};       // a bridge reports at 50 Hz
constexpr Duration kAnswerTime = std::chrono::seconds{10};       // start-up of slow drives
constexpr Duration kCounters = std::chrono::milliseconds{2500};  // reported every second

/// Listens on one LCM network until something has been heard.
class Ear {
 public:
  explicit Ear(const CanOperatorOptions& options)
      : channels(options.vehicle),
        vehicle_(options.vehicle),
        loop_(RealTimeLoop::wall_utime_us()),
        url_(checked_lcm_url(options.lcm_url)),
        bus_(open_bus(url_, loop_)) {}

  template <class LcmType, class Function>
  void hear(const std::string& channel, Function function) {
    subscribe<LcmType>(bus, channel, kDeepQueue, undecodable_,
                       [this, function](const LcmType& message) {
                         function(message);
                         if (enough_ && enough_()) loop_.stop();
                       });
  }

  /// False after `patience`; throws if a signal ends it.
  bool wait(Duration patience, std::function<bool()> enough) {
    enough_ = std::move(enough);
    const Instant end = loop_.now() + patience;
    while (!enough_() && loop_.now() < end) {
      loop_.run_until(end);
      if (loop_.signal() != 0) throw std::runtime_error("interrupted");
    }
    return enough_();
  }

  /// Listens for this long; false if a signal ends it.
  bool listen(Duration time) {
    enough_ = nullptr;
    loop_.run_until(loop_.now() + time);
    return loop_.signal() == 0;
  }

  [[noreturn]] void miss(const std::string& channel, const char* program) const {
    throw std::runtime_error(fmt::format("no {} on {}: is {} running, for vehicle \"{}\"?", channel,
                                         url_, program, vehicle_));
  }

  /// Grows from one call of this program to the next.
  static std::int64_t sequence_number() { return RealTimeLoop::wall_utime_us(); }

  ChannelNames channels;

 private:
  std::string vehicle_;
  RealTimeLoop loop_;
  std::string url_;
  std::unique_ptr<Bus> bus_;
  std::function<bool()> enough_;
  std::int64_t undecodable_ = 0;

 public:
  Bus& bus = *bus_;
};

std::int64_t counter(const counters_t& counters, const std::string& name) {
  const auto found = std::find(counters.name.begin(), counters.name.end(), name);
  if (found == counters.name.end()) return 0;
  return counters.value.at(static_cast<std::size_t>(found - counters.name.begin()));
}

/// The nodes that a fault may be for: the emulated drives' counters begin with them, "node2.rpdos".
std::string nodes(const counters_t& counters) {
  std::set<int> ids;
  for (const std::string& name : counters.name) {
    int id = 0;
    if (std::sscanf(name.c_str(), "node%d.", &id) == 1) ids.insert(id);
  }
  std::string text = "0 (all)";
  for (const int id : ids) text += fmt::format(", {}", id);
  return text;
}

std::string age_text(double age_s) {
  return age_s < 0.0 ? "never" : fmt::format("{:.0f} ms ago", age_s * 1e3);
}

std::string wheel_line(const char* side, double rim_mps, double angle_rad, std::int64_t counts,
                       double age_s, const std::string& state, std::int32_t statusword,
                       std::int32_t error) {
  return fmt::format(
      "{:<9} {:+.3f} m/s, {:.2f} turns, {} counts, {}, {} (0x{:04X}){}\n", side, rim_mps,
      angle_rad / (2.0 * std::numbers::pi), counts, age_text(age_s), state,
      static_cast<std::uint32_t>(statusword),
      error == 0 ? "" : fmt::format(", error 0x{:04X}", static_cast<std::uint32_t>(error)));
}

constexpr Duration kRepeat = std::chrono::milliseconds{50};

/// For requests that act unconditionally. Until a state that came since then, and by which the
/// bridge has had two cycles' time, says what became of it.
int request_stop(const CanOperatorOptions& options, std::int32_t request) {
  Ear ear(options);
  std::optional<drivetrain_state_t> first, state;
  ear.hear<drivetrain_state_t>(ear.channels.can_state, [&](const drivetrain_state_t& m) {
    if (!first) first = m;
    state = m;
  });
  const auto outcome = [&] {
    const Duration since =
        state ? from_utime(state->utime) - from_utime(first->utime) : Duration{0};
    if (since < kRepeat) return RequestOutcome::pending;
    // "Refused" says no more than that no request has arrived yet.
    const RequestOutcome now = judge_request(request, *state, since);
    return now == RequestOutcome::refused ? RequestOutcome::pending : now;
  };
  const auto sends = kAnswerTime / kRepeat;
  for (std::int64_t n = 0; n < sends && outcome() == RequestOutcome::pending; ++n) {
    drive_request_t message{};
    message.utime = state ? state->utime : 0;
    message.run = state ? state->run : 0;
    message.seq = Ear::sequence_number();
    message.request = request;
    publish(ear.bus, ear.channels.can_request, message);
    if (n == kBridgeHello / kRepeat && !state) {
      fmt::print(stderr, "no {} yet: repeating the request; use the hard-wired emergency stop\n",
                 ear.channels.can_state);
    }
    ear.wait(kRepeat, [&] { return outcome() != RequestOutcome::pending; });
  }
  if (!state) ear.miss(ear.channels.can_state, "tether-can-bridge");
  fmt::print("{}\n", state_line(*state));
  if (outcome() == RequestOutcome::reached) return kExitOk;
  fmt::print(stderr, "NOT STOPPED, after {} requests: use the hard-wired emergency stop\n", sends);
  return kExitFailed;
}

}  // namespace

int can_request(const CanOperatorOptions& options, std::int32_t request) {
  if (request == drive_request_t::ESTOP || request == drive_request_t::DISARM) {
    return request_stop(options, request);
  }
  Ear ear(options);
  std::optional<drivetrain_state_t> state;
  ear.hear<drivetrain_state_t>(ear.channels.can_state,
                               [&](const drivetrain_state_t& m) { state = m; });
  if (!ear.wait(kBridgeHello, [&] { return state.has_value(); })) {
    ear.miss(ear.channels.can_state, "tether-can-bridge");
  }
  drive_request_t message{};
  message.utime = state->utime;  // the bridge's clock and run, whatever they are
  message.run = state->run;
  message.seq = Ear::sequence_number();
  message.request = request;
  publish(ear.bus, ear.channels.can_request, message);

  const auto outcome = [&] {
    // States that the bridge sent before it had the request say nothing about it.
    if (state->utime <= message.utime) return RequestOutcome::pending;
    return judge_request(request, *state, from_utime(state->utime) - from_utime(message.utime));
  };
  ear.wait(kAnswerTime, [&] { return outcome() != RequestOutcome::pending; });
  fmt::print("{}\n", state_line(*state));
  return outcome() == RequestOutcome::reached ? kExitOk : kExitFailed;
}

int can_hold(const CanOperatorOptions& options) {
  constexpr Duration kPeriod = std::chrono::milliseconds{50};
  Ear ear(options);
  std::optional<drivetrain_state_t> state;
  ear.hear<drivetrain_state_t>(ear.channels.can_state,
                               [&](const drivetrain_state_t& m) { state = m; });
  std::string shown;
  do {
    if (!state && !ear.wait(kBridgeHello, [&] { return state.has_value(); })) {
      ear.miss(ear.channels.can_state, "tether-can-bridge");
    }
    if (state_line(*state) != shown) {
      shown = state_line(*state);
      fmt::print("{}\n", shown);
      std::fflush(stdout);
    }
    drive_request_t message{};
    message.utime = state->utime;
    message.seq = Ear::sequence_number();
    message.run = state->run;
    message.request = drive_request_t::ALIVE;
    publish(ear.bus, ear.channels.can_request, message);
    state.reset();  // a bridge that is silent is noticed by the next time
  } while (ear.listen(kPeriod));
  return kExitOk;
}

int can_inject(const CanOperatorOptions& options, std::int32_t node, std::int32_t kind,
               double value) {
  Ear ear(options);
  std::optional<counters_t> counters;
  ear.hear<counters_t>(ear.channels.drive_counters, [&](const counters_t& m) { counters = m; });
  if (!ear.wait(kCounters, [&] { return counters.has_value(); })) {
    ear.miss(ear.channels.drive_counters, "tether-can-drive");
  }
  const std::int64_t applied = counter(*counters, "inject.applied");
  const std::int64_t refused = counter(*counters, "inject.refused");
  drive_fault_t message{};
  message.utime = counters->utime;
  message.seq = Ear::sequence_number();
  message.node = node;
  message.kind = kind;
  message.value = value;
  publish(ear.bus, ear.channels.can_inject, message);

  ear.wait(kCounters, [&] { return counters->utime > message.utime; });
  if (counter(*counters, "inject.applied") > applied) {
    fmt::print("injected\n");
    return kExitOk;
  }
  if (counter(*counters, "inject.refused") > refused) {
    if (kind == drive_fault_t::SAFETY_INPUT) {
      fmt::print("refused: the drivetrain has no such safety input, or --value is not 0, 1 or 2\n");
    } else {
      fmt::print("refused: the emulated drives have no such node; allowed: {}\n", nodes(*counters));
    }
  } else {
    fmt::print("not taken: see inject.… in the emulated drives' counters (tether echo)\n");
  }
  return kExitFailed;
}

int can_status(const CanOperatorOptions& options) {
  Ear ear(options);
  std::optional<drivetrain_state_t> state;
  std::optional<wheel_feedback_t> wheels;
  std::optional<odometry_t> odometry;
  ear.hear<drivetrain_state_t>(ear.channels.can_state,
                               [&](const drivetrain_state_t& m) { state = m; });
  ear.hear<wheel_feedback_t>(ear.channels.can_wheels,
                             [&](const wheel_feedback_t& m) { wheels = m; });
  ear.hear<odometry_t>(ear.channels.can_odometry, [&](const odometry_t& m) { odometry = m; });
  ear.wait(kBridgeHello, [&] { return state && wheels && odometry; });
  if (!state) ear.miss(ear.channels.can_state, "tether-can-bridge");

  fmt::print("{:<9} {}\n", "state", state_line(*state));
  fmt::print("{:<9} {}\n", "bus", state->bus);
  fmt::print("{:<9} {:+.3f} m/s, {:+.3f} rad/s; newest command {}\n", "setpoint", state->v_mps,
             state->omega_radps, age_text(state->command_age_s));
  fmt::print("{:<9} {}\n", "disarms", state->disarms);
  if (wheels) {
    const wheel_feedback_t& w = *wheels;
    fmt::print("{}", wheel_line("left", w.left_rim_mps, w.left_angle_rad, w.left_position_counts,
                                w.left_age_s, w.left_state, w.left_statusword, w.left_error_code));
    fmt::print("{}",
               wheel_line("right", w.right_rim_mps, w.right_angle_rad, w.right_position_counts,
                          w.right_age_s, w.right_state, w.right_statusword, w.right_error_code));
  }
  if (odometry) {
    fmt::print(
        "{:<9} x {:.3f} m, y {:.3f} m, yaw {:.3f} rad (1 sigma: {:.3f} m, {:.3f} m, {:.3f} rad); "
        "{:+.3f} m/s, {:+.3f} rad/s; {:.2f} m driven\n",
        "odometry", odometry->x_m, odometry->y_m, odometry->yaw_rad,
        std::sqrt(odometry->cov_x_x_m2), std::sqrt(odometry->cov_y_y_m2),
        std::sqrt(odometry->cov_yaw_yaw_rad2), odometry->v_mps, odometry->omega_radps,
        odometry->distance_m);
  }
  return kExitOk;
}

}  // namespace tether
