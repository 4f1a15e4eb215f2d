#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <chrono>
#include <deque>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "can_bridge/cia402/profile.hpp"
#include "tests/can_bridge/cia402/fake_cia402_drive.hpp"

namespace tether::test {

using std::chrono::milliseconds;

inline constexpr ObjectRef kControl{0x6040, 0, 2, false};
inline constexpr ObjectRef kStatus{0x6041, 0, 2, false};
inline constexpr ObjectRef kTarget{0x60FF, 0, 4, true};
inline constexpr ObjectRef kVelocity{0x606C, 0, 4, true};
inline constexpr ObjectRef kPosition{0x6064, 0, 4, true};
inline constexpr ObjectRef kError{0x603F, 0, 2, false};
inline constexpr ObjectRef kModeDisplay{0x6061, 0, 1, true};

inline PdoConfig pdo(std::uint8_t node, int number, bool transmit, std::vector<ObjectRef> objects,
                     std::uint8_t transmission = 1) {
  PdoConfig p;
  p.node = node;
  p.number = number;
  p.transmit = transmit;
  p.transmission = transmission;
  p.objects = std::move(objects);
  return p;
}

/// Two single-axis nodes, the right one mounted the other way round; 60 rpm a revolution/second.
inline Cia402Config two_nodes() {
  Cia402Config c;
  c.name = "two nodes";
  c.axes[0].node = 1;
  c.axes[1].node = 2;
  c.axes[1].sign = -1;
  for (const std::uint8_t node : {std::uint8_t{1}, std::uint8_t{2}}) {
    c.watchdogs.push_back(
        {node, WatchdogConfig::Kind::heartbeat_consumer, {0x1016, 1, 4, false}, 250});
    c.setup.push_back({node, {0x1029, 1, 1, false}, 0, true, "communication error behaviour"});
    c.setup.push_back({node, {0x6007, 0, 2, true}, 3, false, "abort connection option"});
    c.setup.push_back({node, {0x605A, 0, 2, true}, 6, true, "quick stop option"});
    c.setup.push_back({node, {0x6085, 0, 4, false}, 3000, true, "quick stop deceleration"});
    c.pdos.push_back(pdo(node, 1, false, {kControl, kTarget}));
    c.pdos.back().event_timer_ms = 100;
    c.pdos.push_back(pdo(node, 1, true, {kStatus, kVelocity}));
    c.pdos.push_back(pdo(node, 2, true, {kPosition, kError, kModeDisplay}));
  }
  return c;
}

/// Profile and fake drives on one bus, a tick every 20 ms, replies 1 ms after a frame.
class Bench {
 public:
  static constexpr milliseconds kCycle{20};
  static constexpr double kRadius_m = 0.1;
  static constexpr double kTrack_m = 0.5;

  explicit Bench(const Cia402Config& c = two_nodes()) : config(c), profile(c, kRadius_m, kTrack_m) {
    for (const std::uint8_t node : c.nodes()) {
      drives.emplace_back(c, node);
      drives.back().nmt = canopen::NmtState::pre_operational;
    }
  }

  /// One control cycle: the profile's tick, then what the drives answer.
  void cycle() {
    sent.clear();
    profile.tick(now, sent);
    std::vector<CanFrame> replies;
    bool synced = !config.sync;
    for (const CanFrame& f : sent) {
      log.push_back(f);
      for (FakeDrive& d : drives) d.on_frame(f, replies);
      if (f.id == canopen::kSync) {
        synced = true;
        for (FakeDrive& d : drives) d.cycle(replies);
      }
    }
    if (!config.sync) {
      for (FakeDrive& d : drives) d.cycle(replies);
    }
    if (!synced) {
      for (FakeDrive& d : drives) d.cycle_alone();
    }
    if (++cycles_ % 5 == 0) {
      for (const FakeDrive& d : drives) d.heartbeat(replies);
    }
    for (; !slow_.empty() && slow_.front().first <= now; slow_.pop_front()) {
      deliver(slow_.front().second);
    }
    for (const CanFrame& f : replies) {
      const bool sdo = (f.id & ~0x7Fu) == canopen::kSdoResponse &&
                       (slow_node == 0 || (f.id & 0x7F) == slow_node);
      if (sdo && sdo_delay > milliseconds(0)) {
        slow_.emplace_back(now + sdo_delay, f);
      } else {
        deliver(f);
      }
    }
    now += kCycle;
  }
  void deliver(const CanFrame& f) {
    if (deaf) return;
    profile.on_frame(f, now + milliseconds(1));
  }
  void run(milliseconds time) {
    for (milliseconds t{0}; t < time; t += kCycle) cycle();
  }
  /// False if the condition did not come true in time.
  bool run_until(const std::function<bool()>& condition,
                 milliseconds limit = milliseconds(20'000)) {
    for (milliseconds t{0}; t <= limit; t += kCycle) {
      if (condition()) return true;
      cycle();
    }
    return condition();
  }
  bool reach(DrivePhase phase, milliseconds limit = milliseconds(20'000)) {
    return run_until([this, phase] { return this->phase() == phase; }, limit);
  }
  void to_standby() {
    profile.start(now);
    reach(DrivePhase::standby);
  }
  /// From standby; the next cycle is the first after the configuration has been verified.
  void enable_verified() {
    int cycles = 0;
    profile.enable();
    for (; controlword() == 0; ++cycles) cycle();
    profile.stop(StopKind::disable);
    reach(DrivePhase::standby);
    profile.enable();
    run(kCycle * (cycles - 1));
  }
  void to_enabled() {
    to_standby();
    profile.enable();
    reach(DrivePhase::enabled);
  }
  /// Enabled and rolling at this speed.
  void drive(const Twist& twist, milliseconds time = milliseconds(400)) {
    to_enabled();
    profile.set_command(twist);
    run(time);
  }

  DrivetrainSnapshot snapshot() const { return profile.snapshot(now); }
  DrivePhase phase() const { return snapshot().phase; }
  std::string reason() const { return snapshot().reason; }
  FakeDrive& left() { return drives.front(); }
  FakeDrive& right() { return drives.back(); }
  FakeDrive::Axis& left_axis() { return drives.front().axes.front(); }
  FakeDrive::Axis& right_axis() { return drives.back().axes.back(); }

  /// Controlword and target of the newest RPDO with this identifier, as two_nodes() maps them.
  std::uint16_t controlword(std::uint32_t id = 0x201) const {
    const CanFrame* f = newest(id);
    return f ? static_cast<std::uint16_t>(canopen::read_integer(f->data.data(), 2, false)) : 0xFFFF;
  }
  std::int64_t target(std::uint32_t id = 0x201) const {
    const CanFrame* f = newest(id);
    return f ? canopen::read_integer(f->data.data() + 2, 4, true) : -99;
  }
  const CanFrame* newest(std::uint32_t id) const {
    for (auto f = log.rbegin(); f != log.rend(); ++f) {
      if (f->id == id) return &*f;
    }
    return nullptr;
  }
  long count(const CanFrame& frame) const { return std::count(log.begin(), log.end(), frame); }

  Cia402Config config;
  Cia402Profile profile;
  std::vector<FakeDrive> drives;
  Instant now{};
  std::vector<CanFrame> sent;  // in the newest cycle
  std::vector<CanFrame> log;   // all that the profile ever sent
  bool deaf = false;           // the profile hears nothing
  milliseconds sdo_delay{0};   // delay of each SDO answer …
  std::uint8_t slow_node = 0;  // … from this node; 0: from all

 private:
  int cycles_ = 0;
  std::deque<std::pair<Instant, CanFrame>> slow_;
};

inline CanFrame emergency(std::uint8_t node, std::uint16_t code) {
  return CanFrame::make(canopen::kEmcy + node,
                        {static_cast<std::uint8_t>(code & 0xFF),
                         static_cast<std::uint8_t>(code >> 8), 0, 0, 0, 0, 0, 0});
}

/// The healthy left wheel brakes and goes off; nothing moves again by itself. `braking`: the
/// controlword meanwhile.
inline void expect_left_stops_and_stays_stopped(Bench& bench, int braking = 0x0002) {
  bench.profile.set_command({1.0, 0.0});
  bench.cycle();
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_EQ(bench.controlword(0x201), braking);
  EXPECT_EQ(bench.target(0x201), 0);
  EXPECT_EQ(bench.target(0x202), 0);
  EXPECT_TRUE(bench.run_until(
      [&] { return bench.left_axis().state == canopen::DriveState::switch_on_disabled; },
      milliseconds(1000)));
  EXPECT_EQ(bench.left_axis().speed, 0);
  bench.profile.enable();
  bench.run(milliseconds(1000));
  EXPECT_EQ(bench.phase(), DrivePhase::faulted);
  EXPECT_EQ(bench.left_axis().state, canopen::DriveState::switch_on_disabled);
  EXPECT_EQ(bench.controlword(0x201), 0x0000);
}

}  // namespace tether::test

namespace tether {
inline void PrintTo(DrivePhase phase, std::ostream* out) { *out << to_string(phase); }
}  // namespace tether
