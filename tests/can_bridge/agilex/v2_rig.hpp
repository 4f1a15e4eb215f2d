#pragma once

#include <gmock/gmock.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "can_bridge/agilex/emulated_v2.hpp"
#include "can_bridge/agilex/v2.hpp"
#include "can_bridge/agilex/v2_profile.hpp"

namespace tether::test {

inline constexpr double kRadius_m = 0.4;
inline constexpr double kTrack_m = 1.2;

inline Duration ms(int milliseconds) { return std::chrono::milliseconds(milliseconds); }
inline Instant at_ms(int milliseconds) { return kStart + ms(milliseconds); }

inline AgilexV2Config agilex_chassis() {
  AgilexV2Config config;
  config.name = "test chassis";
  config.chassis_wheel_radius_m = kRadius_m;
  config.chassis_track_m = kTrack_m;
  return config;
}

/// The emulator, with wheels that turn as its servos hold them.
class Chassis {
 public:
  explicit Chassis(Instant now) : emulator(agilex_chassis(), now), now_(now) {}

  /// Millisecond by millisecond.
  std::vector<CanFrame> run_until(Instant end) {
    std::vector<CanFrame> out;
    while (now_ < end) {
      now_ += ms(1);
      const auto targets = emulator.wheel_targets_radps();
      for (std::size_t i = 0; i < 2; ++i) {
        wheels.speed_radps[i] = targets[i];
        wheels.angle_rad[i] += targets[i] * 1e-3;
      }
      emulator.set_wheels(wheels);
      emulator.tick(now_, out);
    }
    return out;
  }
  void send(const CanFrame& frame) {
    std::vector<CanFrame> out;
    emulator.on_frame(frame, now_, out);
    EXPECT_THAT(out, ::testing::IsEmpty());
  }
  Instant now() const { return now_; }
  double rim_mps(std::size_t wheel) const {
    return emulator.wheel_targets_radps()[wheel] * kRadius_m;
  }

  EmulatedAgilexV2 emulator;
  WheelStates wheels;

 private:
  Instant now_;
};

/// The profile, ticked every 20 ms, with the chassis' frames sent by the test.
class Bridge {
 public:
  Bridge() : profile(agilex_chassis(), kRadius_m, kTrack_m) { profile.start(now_); }

  /// Reports of the chassis in each of the following cycles.
  agilex::SystemState state;
  agilex::Motion motion;
  agilex::Odometry odometry;
  bool silent = false;

  std::vector<CanFrame> tick() {
    if (!silent) {
      profile.on_frame(agilex::encode(state), now_);
      profile.on_frame(agilex::encode(agilex::kMotionState, motion), now_);
      profile.on_frame(agilex::encode(odometry), now_);
    }
    std::vector<CanFrame> out;
    profile.tick(now_, out);
    now_ += ms(20);
    return out;
  }
  std::vector<CanFrame> tick_for(int milliseconds) {
    std::vector<CanFrame> all;
    for (int t = 0; t < milliseconds; t += 20) {
      const auto out = tick();
      all.insert(all.end(), out.begin(), out.end());
    }
    return all;
  }
  void to_enabled() {
    tick();
    profile.enable();
    tick();
    state.mode = agilex::Mode::can;
    tick();
    ASSERT_EQ(phase(), DrivePhase::enabled);
  }
  Instant now() const { return now_; }
  DrivePhase phase() const { return snapshot().phase; }
  std::string reason() const { return snapshot().reason; }
  /// Snapshot of the last tick.
  DrivetrainSnapshot snapshot() const { return profile.snapshot(now_ - ms(20)); }

  AgilexV2Profile profile;

 private:
  Instant now_ = kStart;
};

/// The newest frame with this identifier.
inline CanFrame newest(const std::vector<CanFrame>& frames, std::uint32_t id) {
  for (auto i = frames.rbegin(); i != frames.rend(); ++i) {
    if (i->id == id) return *i;
  }
  ADD_FAILURE() << "no frame " << std::hex << id;
  return {};
}

inline std::ptrdiff_t count(const std::vector<CanFrame>& frames, std::uint32_t id) {
  return std::count_if(frames.begin(), frames.end(),
                       [id](const CanFrame& f) { return f.id == id; });
}

}  // namespace tether::test
