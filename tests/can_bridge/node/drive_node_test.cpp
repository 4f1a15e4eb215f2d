#include <gtest/gtest.h>

#include <limits>
#include <tether/counters_t.hpp>
#include <tether/drive_fault_t.hpp>
#include <tether/wheel_states_t.hpp>
#include <tether/wheel_targets_t.hpp>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/node/can_drive_node.hpp"
#include "common/scenario/run_settings.hpp"
#include "tests/can_bridge/emulated/drive_rig.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::counter;
using test::Seen;
using test::two_node_drivetrain;
using test::VirtualWorld;

/// A port whose other end is the test: frames reach the node at once, and what it sends is kept.
class FakePort final : public CanPort {
 public:
  explicit FakePort(EventLoop& loop) : loop_(loop) {}

  struct Sent {
    Instant when;
    CanFrame frame;
  };
  std::vector<Sent> sent;
  bool takes_frames = true;

  void arrive(const CanFrame& frame) {
    for (const CanFilter& filter : filters_) {
      if (filter.passes(frame)) return handler_(frame);
    }
  }
  std::vector<Sent> sent_with(std::uint32_t id) const {
    std::vector<Sent> found;
    for (const Sent& s : sent) {
      if (s.frame.id == id) found.push_back(s);
    }
    return found;
  }

  bool send(const CanFrame& frame) override {
    if (takes_frames) sent.push_back({loop_.now(), frame});
    return takes_frames;
  }
  void on_frame(std::vector<CanFilter> filters, FrameHandler handler) override {
    filters_ = std::move(filters);
    handler_ = std::move(handler);
  }
  void on_state(StateHandler) override {}
  CanState state() const override { return CanState::up; }
  bool restart(std::string&) override { return false; }
  void list(CounterList& out) const override {
    out.emplace_back("can.sent", static_cast<std::int64_t>(sent.size()));
  }

 private:
  EventLoop& loop_;
  std::vector<CanFilter> filters_;
  FrameHandler handler_;
};

struct DriveWorld {
  explicit DriveWorld(Instant start = kStart) : world{VirtualLoop(start)} {}

  VirtualWorld world;
  FakePort port{world.loop};
  Scenario scenario;
  DrivetrainConfig config = two_node_drivetrain();
  std::vector<Seen<wheel_targets_t>> targets;
  std::vector<Seen<wheel_states_t>> wheels;
  std::vector<Seen<counters_t>> counters;
  std::unique_ptr<CanDriveNode> node;

  void make(bool standalone = false) {
    world.collect("SIM/WHEEL_TARGETS", targets);
    world.collect("SIM/WHEELS", wheels);
    world.collect("CAN/DRIVE_COUNTERS", counters);
    using Wheels = CanSettings::Wheels;
    scenario.get<CanSettings>().wheels = standalone ? Wheels::model : Wheels::sim;
    node = std::make_unique<CanDriveNode>(scenario, config, world.loop, world.bus, port);
  }
  void arrive_at(Instant when, std::uint32_t id, std::initializer_list<std::uint8_t> bytes) {
    world.loop.at(when, Priority::node,
                  [this, frame = CanFrame::make(id, bytes)](Instant) { port.arrive(frame); });
  }
  /// Both drives enabled at 60 rpm by SDO from 0.4 s on; the right one turns backwards for that.
  void drive_from_400ms() {
    for (std::uint8_t node : {1, 2}) {
      const std::uint32_t id = 0x600u + node;
      arrive_at(at_ms(400), id, {0x2F, 0x60, 0x60, 0, 3, 0, 0, 0});
      arrive_at(at_ms(400), id, {0x23, 0x83, 0x60, 0, 0x60, 0xEA, 0, 0});
      arrive_at(at_ms(400), id, {0x2B, 0x40, 0x60, 0, 0x06, 0, 0, 0});
      arrive_at(at_ms(405), id, {0x2B, 0x40, 0x60, 0, 0x07, 0, 0, 0});
      arrive_at(at_ms(410), id, {0x2B, 0x40, 0x60, 0, 0x0F, 0, 0, 0});
      arrive_at(at_ms(415), id, {0x23, 0xFF, 0x60, 0, 60, 0, 0, 0});
    }
  }
  static wheel_states_t wheel_states(Instant stamp, std::int64_t seq, double angle_rad,
                                     double speed_radps) {
    wheel_states_t m{};
    m.utime = to_utime(stamp);
    m.seq = seq;
    m.left_angle_rad = m.right_angle_rad = angle_rad;
    m.left_speed_radps = m.right_speed_radps = speed_radps;
    return m;
  }
  static drive_fault_t fault(Instant stamp, std::int64_t seq, int node, int kind, double value) {
    drive_fault_t m{};
    m.utime = to_utime(stamp);
    m.seq = seq;
    m.node = node;
    m.kind = kind;
    m.value = value;
    return m;
  }
  /// Reads an object at `when`: its data bytes are in the next frame 0x581.
  void read_at(Instant when, std::uint16_t index) {
    arrive_at(when, 0x601,
              {0x40, static_cast<std::uint8_t>(index & 0xFF), static_cast<std::uint8_t>(index >> 8),
               0, 0, 0, 0, 0});
  }
  std::int32_t answer(std::size_t i) const {
    const CanFrame f = port.sent_with(0x581).at(i).frame;
    return static_cast<std::int32_t>(canopen::read_integer(f.data.data() + 4, 4, true));
  }
};

TEST(CanDriveNode, SpeaksForSafetyInputsUnlessRealDrivesAreOnTheBus) {
  for (const bool emulates : {true, false}) {
    DriveWorld w;
    SafetyInputConfig input;
    input.wiring = CanInputWiring{.id = 0x3A0, .clear = 0x55};
    std::get<Cia402Config>(w.config).safety_inputs = {input};
    w.scenario.get<CanSettings>().emulate_drives = emulates;
    w.make();
    w.world.loop.run_until(at_ms(98));
    EXPECT_EQ(w.port.sent_with(0x3A0).size(), emulates ? 3U : 0U);  // every 33 ms
  }
}

TEST(CanDriveNode, DrivesBootBeforeTheRunIfThereIsLeadTime) {
  DriveWorld s(at_s(-3.0));
  s.scenario.get<RunSettings>().lead_s = 2.0;
  s.make();
  s.world.publish_at(at_s(-1.5), "SIM/WHEELS", DriveWorld::wheel_states(at_s(-1.5), 0, 0, 6.2832));
  s.read_at(at_s(-1.499), 0x606C);
  s.world.loop.run_until(at_s(-1.0));
  ASSERT_EQ(s.port.sent_with(0x701).size(), 1u);
  EXPECT_EQ(s.port.sent_with(0x701)[0].when, at_s(-1.7));
  EXPECT_EQ(s.targets.front().when, at_s(-2.0));
  EXPECT_EQ(s.answer(0), 60) << "and its messages are of this run";
}

TEST(CanDriveNode, AnswersAtTheInstantOfTheRequest) {
  DriveWorld s;
  s.make();
  s.read_at(at_ms(400.5), 0x1000);
  s.world.loop.run_until(at_s(1));
  ASSERT_EQ(s.port.sent_with(0x581).size(), 1u);
  EXPECT_EQ(s.port.sent_with(0x581)[0].when, at_ms(400.5));
  EXPECT_EQ(s.answer(0), 0x00020192);
}

TEST(CanDriveNode, PublishesTargetsEvery5MsAlsoWhileTheDrivesAreOff) {
  DriveWorld s;
  s.make();
  s.world.loop.run_until(at_ms(101));
  ASSERT_EQ(s.targets.size(), 21u);
  EXPECT_EQ(s.targets[20].when, at_ms(100));
  EXPECT_EQ(s.targets[20].message.utime, 100'000);
  EXPECT_EQ(s.targets[20].message.seq, 20);
  EXPECT_EQ(s.targets[20].message.left_speed_radps, 0.0);
}

TEST(CanDriveNode, TargetsAreTheDrivesSetpoints) {
  DriveWorld s;
  s.make();
  s.drive_from_400ms();
  s.world.loop.run_until(at_ms(500));
  EXPECT_NEAR(s.targets.back().message.left_speed_radps, 6.2832, 1e-4);
  EXPECT_NEAR(s.targets.back().message.right_speed_radps, -6.2832, 1e-4);
  EXPECT_TRUE(s.wheels.empty()) << "the wheels are the simulator's";
}

TEST(CanDriveNode, WheelsReachTheEncoders) {
  DriveWorld s;
  s.make();
  s.world.publish_at(at_ms(400), "SIM/WHEELS", DriveWorld::wheel_states(at_ms(400), 0, 0.0, 0.0));
  s.world.publish_at(at_ms(402), "SIM/WHEELS",
                     DriveWorld::wheel_states(at_ms(402), 1, 6.2832, 6.2832));
  s.read_at(at_ms(405), 0x6064);
  s.read_at(at_ms(405), 0x606C);
  s.world.loop.run_until(at_ms(410));
  EXPECT_EQ(s.answer(0), 4096);
  EXPECT_EQ(s.answer(1), 60);
}

TEST(CanDriveNode, WheelsThatFallSilentKeepTheirPositionAndLoseTheirSpeedAfter100Ms) {
  DriveWorld s;
  s.make();
  s.world.publish_at(at_ms(400), "SIM/WHEELS",
                     DriveWorld::wheel_states(at_ms(400), 0, 6.2832, 6.2832));
  s.read_at(at_ms(499.5), 0x606C);
  s.read_at(at_ms(500.5), 0x606C);
  s.read_at(at_ms(500.5), 0x6064);
  s.world.loop.run_until(at_s(1));
  EXPECT_EQ(s.answer(0), 60);
  EXPECT_EQ(s.answer(1), 0);
  EXPECT_EQ(s.answer(2), 4096);
  s.node->finish();
  s.world.loop.run_until(at_s(1));
  EXPECT_EQ(counter(s.counters.back().message, "wheels.timeouts"), 1);
}

TEST(CanDriveNode, UnusableWheelsAreCountedAndIgnored) {
  DriveWorld s;
  s.make();
  const auto good = DriveWorld::wheel_states(at_ms(400), 5, 6.2832, 6.2832);
  s.world.publish_at(at_ms(400), "SIM/WHEELS", good);
  auto bad = DriveWorld::wheel_states(at_ms(401), 6, 9.0, 0.0);
  bad.left_speed_radps = std::numeric_limits<double>::quiet_NaN();
  s.world.publish_at(at_ms(401), "SIM/WHEELS", bad);
  s.world.publish_at(at_ms(402), "SIM/WHEELS", DriveWorld::wheel_states(at_ms(402), 7, 1e300, 0.0));
  s.world.publish_at(at_ms(403), "SIM/WHEELS", DriveWorld::wheel_states(at_ms(399), 4, 9.0, 0.0));
  s.world.publish_at(at_ms(404), "SIM/WHEELS", DriveWorld::wheel_states(at_s(9), 8, 9.0, 0.0));
  s.world.publish_bytes_at(at_ms(405), "SIM/WHEELS", {1, 2, 3});
  s.read_at(at_ms(410), 0x6064);
  s.world.loop.run_until(at_ms(420));
  EXPECT_EQ(s.answer(0), 4096);
  s.node->finish();
  s.world.loop.run_until(at_ms(420));
  const counters_t& c = s.counters.back().message;
  EXPECT_EQ(counter(c, "wheels.accepted"), 1);
  EXPECT_EQ(counter(c, "wheels.non_finite"), 2);
  EXPECT_EQ(counter(c, "wheels.reordered"), 1);
  EXPECT_EQ(counter(c, "wheels.from_future"), 1);
  EXPECT_EQ(counter(c, "wheels.undecodable"), 1);
}

TEST(CanDriveNode, StandaloneItTurnsItsOwnWheelsAndShowsThem) {
  DriveWorld s;
  s.make(true);
  s.drive_from_400ms();
  s.world.loop.run_until(at_s(3));
  EXPECT_TRUE(s.targets.empty());
  ASSERT_FALSE(s.wheels.empty());
  EXPECT_EQ(s.wheels[1].when - s.wheels[0].when, std::chrono::milliseconds{5});
  EXPECT_NEAR(s.wheels.back().message.left_speed_radps, 6.2832, 0.01);
  EXPECT_NEAR(s.wheels.back().message.right_speed_radps, -6.2832, 0.01);
  EXPECT_GT(s.wheels.back().message.left_angle_rad, 10.0);
}

TEST(CanDriveNode, TheScenarioInjectsOneFaultAtItsTime) {
  DriveWorld s;
  s.scenario.get<CanSettings>().inject = CanSettings::Inject::fault;
  s.scenario.get<CanSettings>().inject_at_s = 0.5;
  s.scenario.get<CanSettings>().inject_node = 2;
  s.scenario.get<CanSettings>().inject_value = 0x2310;
  s.make();
  s.world.loop.run_until(at_s(2));
  EXPECT_TRUE(s.port.sent_with(0x081).empty());
  ASSERT_EQ(s.port.sent_with(0x082).size(), 1u);
  const auto sent = s.port.sent_with(0x082)[0];
  EXPECT_GE(sent.when, at_ms(500));
  EXPECT_LE(sent.when, at_ms(501));
  EXPECT_EQ(sent.frame.data[0] | sent.frame.data[1] << 8, 0x2310);
}

TEST(CanDriveNode, FaultsComeByMessageToo) {
  DriveWorld s;
  s.make();
  s.world.publish_at(at_ms(500), "CAN/INJECT",
                     DriveWorld::fault(at_ms(500), 0, 1, drive_fault_t::REBOOT, 0.0));
  s.world.loop.run_until(at_s(1));
  ASSERT_EQ(s.port.sent_with(0x701).size(), 2u);
  EXPECT_EQ(s.port.sent_with(0x702).size(), 1u);
}

TEST(CanDriveNode, SenselessFaultsAreCountedAndIgnored) {
  DriveWorld s;
  s.make();
  std::int64_t seq = 0;
  const auto ask = [&](int node, int kind, double value) {
    s.world.publish_at(at_ms(500), "CAN/INJECT",
                       DriveWorld::fault(at_ms(500), seq++, node, kind, value));
  };
  ask(3, drive_fault_t::FAULT, 0.0);
  ask(-1, drive_fault_t::FAULT, 0.0);
  ask(1, 7, 0.0);
  ask(1, -1, 0.0);
  ask(1, drive_fault_t::WHEEL_SLIP, std::numeric_limits<double>::infinity());
  s.world.loop.run_until(at_s(1));
  s.node->finish();
  s.world.loop.run_until(at_s(1));
  EXPECT_EQ(counter(s.counters.back().message, "inject.refused"), 5);
  EXPECT_EQ(counter(s.counters.back().message, "inject.applied"), 0);
  EXPECT_EQ(s.port.sent.size(), 2u) << "the boot-up messages";
}

TEST(CanDriveNode, ReportsTheBusAndEachDrive) {
  DriveWorld s;
  s.make();
  s.read_at(at_ms(400), 0x1234);
  s.world.loop.run_until(at_s(1));
  ASSERT_EQ(s.counters.size(), 1u);
  const counters_t& c = s.counters[0].message;
  EXPECT_EQ(c.node, "drive");
  EXPECT_EQ(counter(c, "can.sent"), 3);
  EXPECT_EQ(counter(c, "node1.sdo_aborts"), 1);
  EXPECT_EQ(counter(c, "node2.sdo_aborts"), 0);
  EXPECT_EQ(counter(c, "node2.boots"), 1);
  EXPECT_EQ(counter(c, "node2.heartbeat_timeouts"), 0);
}

TEST(CanDriveNode, FramesThatTheBusDoesNotTakeAreLostNotKept) {
  DriveWorld s;
  s.make();
  s.port.takes_frames = false;
  s.world.loop.run_until(at_ms(500));
  s.port.takes_frames = true;
  s.world.loop.run_until(at_s(1));
  EXPECT_TRUE(s.port.sent.empty());
}

}  // namespace
}  // namespace tether
