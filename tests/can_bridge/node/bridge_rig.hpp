#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <tether/counters_t.hpp>
#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <tether/odometry_t.hpp>
#include <tether/plan_in_force_t.hpp>
#include <tether/wheel_feedback_t.hpp>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/node/can_bridge_node.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "tests/can_bridge/node/bridge_fakes.hpp"
#include "tests/common/actuator/plan_rig.hpp"
#include "tests/support/telling_bus.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether::test {

/// The bridge's node with a drive profile that obeys; what it publishes.
struct BridgeRig : ::testing::Test {
  Scenario scenario;
  VirtualWorld world;
  TellingBus bus{world.bus, sender_by_number};
  FakePort port;
  FakeProfile* profile = nullptr;  // the node's
  std::unique_ptr<CanBridgeNode> node;
  std::vector<Seen<drivetrain_state_t>> states;
  std::vector<Seen<wheel_feedback_t>> wheels;
  std::vector<Seen<odometry_t>> odometry;
  std::vector<Seen<counters_t>> counters;
  std::int64_t request_seq = 0;

  BridgeRig() { scenario.get<CanSettings>().cycle_ms = 20.0; }

  void start() {
    world.collect("CAN/STATE", states);
    world.collect("CAN/WHEELS", wheels);
    world.collect("CAN/ODOMETRY", odometry);
    world.collect("CAN/COUNTERS", counters);
    auto owned = std::make_unique<FakeProfile>();
    profile = owned.get();
    node = std::make_unique<CanBridgeNode>(scenario, drivetrain(), world.loop, bus, port,
                                           std::move(owned));
  }
  void request_at(Instant when, std::int32_t what) {
    drive_request_t m{};
    m.utime = to_utime(when);
    m.seq = request_seq++;
    m.request = what;
    world.publish_at(when, "CAN/REQUEST", m);
  }
  /// Commands every 50 ms in [from, to): zero until 0.5 s, then `v_mps`; ARM at 0.3 s.
  void steer(double to_s, double v_mps) {
    request_at(at_s(0.3), drive_request_t::ARM);
    int seq = 0;
    for (int ms = 0; ms < to_s * 1000; ms += 50) {
      world.publish_at(at_ms(ms), "AGV/CMD_VEL",
                       twist(at_ms(ms), seq++, ms < 500 ? 0.0 : v_mps, 0.0));
    }
  }
  const drivetrain_state_t& state() const { return states.back().message; }
  std::int64_t count(const std::string& name) {
    node->finish();
    world.loop.run_until(world.loop.now());
    return counter(counters.back().message, name);
  }
  int fastest_sent_mmps() const {
    int fastest = 0;
    for (const CanFrame& f : port.sent) {
      if (f.id == 0x201) fastest = std::max(fastest, std::abs(setpoint_mmps(f)));
    }
    return fastest;
  }
};

}  // namespace tether::test
