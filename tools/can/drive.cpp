#include "tools/can/drive.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <numbers>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <tether/twist_t.hpp>

#include "common/base/errors.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/message_io.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/program/cli.hpp"
#include "tools/can/twist_drive.hpp"

namespace tether {
namespace {

constexpr Duration kFirstReport = std::chrono::seconds{2};  // a bridge reports at 50 Hz
constexpr Duration kListen = std::chrono::milliseconds{300};

class DriveSession {
 public:
  DriveSession(const CanOperatorOptions& options, const CanDriveOptions& drive)
      : vehicle_(options.vehicle),
        channels_(options.vehicle),
        for_s_(drive.for_s),
        twist_(drive.twist),
        loop_(RealTimeLoop::wall_utime_us()),
        url_(checked_lcm_url(options.lcm_url)),
        network_(open_bus(url_, loop_)) {
    subscribe<drivetrain_state_t>(bus_, channels_.can_state, kDeepQueue, undecodable_,
                                  [this](const drivetrain_state_t& m) { on_state(m); });
    subscribe<odometry_t>(bus_, channels_.can_odometry, kDeepQueue, undecodable_,
                          [this](const odometry_t& m) {
                            if (drive_) drive_->on_odometry(m);
                          });
    subscribe<twist_t>(bus_, channels_.vehicle_command, kDeepQueue, undecodable_,
                       [this](const twist_t& m) { on_command(m); });
    for (const std::string& channel : {channels_.vehicle_plan, channels_.vehicle_preload}) {
      bus_.subscribe(channel, kDeepQueue, [this, channel](const Message&) { on_foreign(channel); });
    }
  }

  int run() {
    greet();
    drive_.emplace(twist_, from_seconds(for_s_), loop_.now());
    loop_.every(loop_.now(), TwistDrive::kPeriod, Priority::node, [this](Instant) { step(); });
    while (drive_->phase() != TwistDrive::Phase::done) {
      loop_.run();  // ends with a signal, too: then zero commands go on for a while
      if (loop_.signal() != 0) drive_->interrupt(loop_.now());
    }
    fmt::print("driven {:.3f} m, turned {:+.4f} rad ({:+.3f} turns), by {}\n", drive_->distance_m(),
               drive_->yaw_rad(), drive_->yaw_rad() / (2.0 * std::numbers::pi),
               channels_.can_odometry);
    if (!drive_->failure().empty()) throw std::runtime_error(drive_->failure());
    fmt::print("no commands any more: the drivetrain disarms\n");
    return kExitOk;
  }

 private:
  /// Listens until the bridge's clock is known, and at least for a moment, to hear whether another
  /// program sends commands.
  void greet() {
    const Instant begin = loop_.now();
    while (loop_.now() < begin + kListen || (!clock_ && loop_.now() < begin + kFirstReport)) {
      loop_.run_until(begin + (loop_.now() < begin + kListen ? kListen : kFirstReport));
      if (loop_.signal() != 0) throw std::runtime_error("interrupted");
    }
    if (!clock_) {
      throw std::runtime_error(
          fmt::format("no {} on {}: is tether-can-bridge running, for vehicle \"{}\"?",
                      channels_.can_state, url_, vehicle_));
    }
    if (!foreign_.empty()) {
      throw std::runtime_error(fmt::format(
          "another program sends {}: end it first, for two senders would take turns", foreign_));
    }
  }

  void on_state(const drivetrain_state_t& m) {
    const bool first = !clock_;
    clock_ = from_utime(m.utime) - loop_.now();
    run_ = m.run;
    if (drive_) drive_->on_state(m, loop_.now());
    if (drive_ && drive_->phase() == TwistDrive::Phase::waiting) show_waiting(m);
    if (first) loop_.stop();
  }

  void show_waiting(const drivetrain_state_t& m) {
    if (m.state == drivetrain_state_t::ARMED || state_line(m) == shown_) return;
    shown_ = state_line(m);
    fmt::print("{}; zero is commanded; waiting for: tether can arm\n", shown_);
    std::fflush(stdout);
  }

  void on_command(const twist_t& m) {
    if (own_stamps_.contains(m.utime)) return;
    on_foreign(channels_.vehicle_command);
  }

  void on_foreign(const std::string& channel) {
    foreign_ = channel;
    if (drive_) drive_->on_foreign_command(loop_.now());
  }

  void step() {
    const auto before = drive_->phase();
    const Twist twist = drive_->step(loop_.now());
    if (before == TwistDrive::Phase::waiting && drive_->phase() == TwistDrive::Phase::driving) {
      fmt::print("armed: {:.3f} m/s, {:.3f} rad/s for {} s\n", twist.v_mps, twist.omega_radps,
                 for_s_);
      std::fflush(stdout);
    }
    if (drive_->phase() == TwistDrive::Phase::done) return loop_.stop();
    twist_t message{};
    // Follows the bridge's clock: the bridge may have restarted, with another clock.
    message.utime = to_utime(loop_.now() + *clock_);
    message.seq = seq_++;
    message.run = run_;
    message.pose_utime = -1;
    message.v_mps = twist.v_mps;
    message.omega_radps = twist.omega_radps;
    own_stamps_.insert(message.utime);
    publish(bus_, channels_.vehicle_command, message);
  }

  std::string vehicle_;
  ChannelNames channels_;
  double for_s_;
  Twist twist_;
  RealTimeLoop loop_;
  std::string url_;
  std::unique_ptr<Bus> network_;
  Bus& bus_ = *network_;
  std::optional<TwistDrive> drive_;
  std::optional<Duration> clock_;  // the bridge's minus this loop's
  std::int64_t run_ = 0;           // the bridge's
  std::set<std::int64_t> own_stamps_;
  std::string foreign_;  ///< channel of another sender
  std::string shown_;
  std::int64_t seq_ = 0;
  std::int64_t undecodable_ = 0;
};

}  // namespace

int can_drive(const CanOperatorOptions& options, const CanDriveOptions& drive) {
  if (drive.twist.v_mps == 0.0 && drive.twist.omega_radps == 0.0) {
    throw UsageError("nothing to drive: give --v-mps or --omega-radps");
  }
  return DriveSession(options, drive).run();
}

}  // namespace tether
