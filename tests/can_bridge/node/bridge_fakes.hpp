#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "can_bridge/bus/can_port.hpp"
#include "can_bridge/drivetrain/drive_profile.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "common/node/event_loop.hpp"

namespace tether::test {

/// A bus end that keeps what is sent.
struct FakePort final : CanPort {
  std::vector<CanFrame> sent;
  std::function<void()> on_send;
  FrameHandler frame_handler;
  StateHandler state_handler;
  CanState now = CanState::up;
  int restarts = 0;
  bool can_restart = true;
  std::string warned;

  bool send(const CanFrame& frame) override {
    sent.push_back(frame);
    if (on_send) on_send();
    return true;
  }
  void on_frame(std::vector<CanFilter>, FrameHandler handler) override {
    frame_handler = std::move(handler);
  }
  void on_state(StateHandler handler) override { state_handler = std::move(handler); }
  CanState state() const override { return now; }
  bool restart(std::string& why) override {
    ++restarts;
    if (!can_restart) why = "run: ip link set can0 down";
    if (can_restart) now = CanState::up;
    return can_restart;
  }
  std::string warning() const override { return warned; }
  void list(CounterList& out) const override {
    out.emplace_back("can.sent", static_cast<std::int64_t>(sent.size()));
  }
  void change(CanState state) {
    now = state;
    state_handler(state);
  }
};

/// Drives that obey within a cycle; each tick sends a heartbeat and an RPDO whose target is the
/// speed in mm/s, or `forced_mmps` regardless of its setpoint.
struct FakeProfile final : DriveProfile {
  DrivetrainSnapshot now;
  std::vector<CanFrame> heard;
  std::vector<Instant> ticks;
  std::vector<Instant> starts;
  Twist command;
  std::int32_t forced_mmps = 0;
  std::string seen_intruder;
  std::string seen_warnings;
  std::vector<StopKind> stops;
  std::vector<Instant> distrusted_until;
  int fault_resets = 0;
  std::vector<CanFilter> own{CanFilter{0x181}};

  FakeProfile() { now.standstill = now.feedback_fresh = true; }
  std::vector<CanFilter> filters() const override { return own; }
  void start(Instant t) override { starts.push_back(t); }
  void on_frame(const CanFrame& frame, Instant) override { heard.push_back(frame); }
  void tick(Instant t, std::vector<CanFrame>& out) override {
    ticks.push_back(t);
    if (now.phase == DrivePhase::starting) now.phase = DrivePhase::standby;
    if (now.phase == DrivePhase::enabling) now.phase = DrivePhase::enabled;
    if (now.phase == DrivePhase::stopping && now.standstill) now.phase = DrivePhase::standby;
    const auto mmps = forced_mmps != 0
                          ? forced_mmps
                          : static_cast<std::int32_t>(std::lround(command.v_mps * 1e3));
    out.push_back(CanFrame::make(0x77F, {0x05}));
    out.push_back(CanFrame::make(
        0x201, {0x0F, 0x00, static_cast<std::uint8_t>(mmps), static_cast<std::uint8_t>(mmps >> 8),
                static_cast<std::uint8_t>(mmps >> 16), static_cast<std::uint8_t>(mmps >> 24)}));
  }
  void set_command(const Twist& t) override { command = t; }
  void enable() override { now.phase = DrivePhase::enabling; }
  void stop(StopKind kind) override {
    stops.push_back(kind);
    now.phase = DrivePhase::stopping;
  }
  void distrust_standstill(Instant until) override { distrusted_until.push_back(until); }
  void reset_fault() override {
    ++fault_resets;
    now.phase = DrivePhase::starting;
  }
  DrivetrainSnapshot snapshot(Instant) const override { return now; }
  Counters counters() const override {
    return {.rejected_frames = 3, .intruder_frames = 4, .warnings = 5, .surplus_feedback = 5};
  }
  std::string intruder() const override { return seen_intruder; }
  std::string warnings() const override { return seen_warnings; }
};

inline std::int32_t setpoint_mmps(const CanFrame& frame) {
  return static_cast<std::int32_t>(frame.data[2] | frame.data[3] << 8 | frame.data[4] << 16 |
                                   static_cast<std::uint32_t>(frame.data[5]) << 24);
}

inline DrivetrainConfig drivetrain() {
  Cia402Config config;
  PdoConfig rpdo;
  rpdo.objects = {config.axes[0].controlword, config.axes[0].target_velocity};
  config.pdos = {rpdo};
  return config;
}

/// A loop whose clock a test moves: periodic tasks are called for every period, however late.
struct LateLoop final : EventLoop {
  Instant time = kStart;
  Instant next = kStart;
  Duration period{};
  Task task;

  Instant now() const override { return time; }
  double rate() const override { return 1.0; }
  void at(Instant, Priority, Task) override {}
  void every(Instant first, Duration p, Priority priority, Task t) override {
    if (priority != Priority::node) return;  // the counters' report
    next = first;
    period = p;
    task = std::move(t);
  }
  void add_fd(int, Task) override {}
  void remove_fd(int) override {}
  void stop() override {}
  std::uint64_t slips() const override { return 0; }
  void wake_up_at(Instant t) {
    time = t;
    for (; next <= time; next += period) task(next);
  }
};

}  // namespace tether::test
