#include <benchmark/benchmark.h>
#include <fmt/format.h>
#include <linux/can.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <exception>
#include <functional>
#include <stdexcept>
#include <string>
#include <tether/drivetrain_state_t.hpp>
#include <tether/twist_t.hpp>
#include <utility>
#include <vector>

#include "bench/cpu_time.hpp"
#include "bench/run.hpp"
#include "bench/smoke.hpp"
#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/node/can_bridge_node.hpp"
#include "can_bridge/node/can_drive_node.hpp"
#include "common/base/errors.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/message_io.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/scenario/run_settings.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/can/arm_operator.hpp"

// CPU load of the bridge on this kernel, which need not have CAN: bridge and emulated drives are
// processes, on real LCM and in real time; a pair of local datagram sockets is the bus, with the
// system calls that a CAN socket takes. Runs through tests/support/in_own_network.sh.

namespace tether {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr seconds kSettle{1};
const seconds kWindow = bench::window(seconds{10});
constexpr int kTries = 5;

/// One end of the pair of sockets.
class LocalPort final : public CanPort {
 public:
  LocalPort(int fd, EventLoop& loop) : fd_(fd), loop_(loop) {}

  bool send(const CanFrame& frame) override {
    can_frame raw{};
    raw.can_id = frame.id;
    raw.can_dlc = frame.size;
    std::copy(frame.data.begin(), frame.data.end(), std::begin(raw.data));
    return ::send(fd_, &raw, sizeof raw, MSG_DONTWAIT) == sizeof raw;
  }
  void on_frame(std::vector<CanFilter> filters, FrameHandler handler) override {
    filters_ = std::move(filters);
    handler_ = std::move(handler);
    loop_.add_fd(fd_, [this](Instant) { read_frames(); });
  }
  void on_state(StateHandler) override {}
  CanState state() const override { return CanState::up; }
  bool restart(std::string& why) override {
    why = "there is nothing to restart";
    return false;
  }
  void list(CounterList&) const override {}

 private:
  void read_frames() {
    can_frame raw{};
    while (recv(fd_, &raw, sizeof raw, MSG_DONTWAIT) == sizeof raw) {
      const CanFrame frame =
          CanFrame::make(raw.can_id, std::span(std::begin(raw.data), raw.can_dlc));
      const bool wanted = std::any_of(filters_.begin(), filters_.end(),
                                      [&](const CanFilter& f) { return f.passes(frame); });
      if (wanted) handler_(frame);
    }
  }

  int fd_;
  EventLoop& loop_;
  std::vector<CanFilter> filters_;
  FrameHandler handler_;
};

/// A process that runs one node until it is killed; it dies with its parent, too.
class ChildNode {
 public:
  template <class NodeType>
  static ChildNode start(const Scenario& scenario, std::int64_t start_utime_us, int fd) {
    const pid_t pid = check_system_call("starting a process", fork());
    if (pid != 0) return ChildNode(pid);
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    try {
      const DrivetrainConfig config = load_drivetrain(scenario.get<CanSettings>().drivetrain_file);
      RealTimeLoop loop(start_utime_us);
      UdpmBus bus(kDefaultLcmUrl, loop);
      LocalPort port(fd, loop);
      NodeType node(scenario, config, loop, bus, port);
      loop.run();
    } catch (const std::exception& error) {
      fmt::print(stderr, "{}\n", error.what());
    }
    _exit(1);
  }
  ChildNode(ChildNode&& other) noexcept : pid_(std::exchange(other.pid_, -1)) {}
  ChildNode(const ChildNode&) = delete;
  ChildNode& operator=(const ChildNode&) = delete;
  ChildNode& operator=(ChildNode&&) = delete;
  ~ChildNode() {
    if (pid_ < 0) return;
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }

  double cpu_seconds() const { return bench::cpu_seconds(pid_); }

 private:
  explicit ChildNode(pid_t pid) : pid_(pid) {}

  pid_t pid_;
};

/// Arms the drivetrain and has it drive a curve, with commands at 20 Hz.
class Driver {
 public:
  Driver(const Scenario& scenario, std::int64_t start_utime_us)
      : loop_(start_utime_us), bus_(kDefaultLcmUrl, loop_), operator_(scenario, loop_, bus_) {
    subscribe<drivetrain_state_t>(bus_, "CAN/STATE", kDeepQueue, undecodable_,
                                  [this](const drivetrain_state_t& m) {
                                    was_armed_ = was_armed_ || armed();
                                    state_ = m;
                                    if (was_armed_ && !armed()) loop_.stop();
                                  });
    loop_.every(loop_.now(), milliseconds{50}, Priority::node, [this](Instant) { command(); });
  }

  void run_to(Instant end) { loop_.run_until(end); }
  void check_armed() const {
    if (!armed()) {
      throw std::runtime_error(
          fmt::format("the drivetrain is {}: {}", state_.state_name, state_.reason));
    }
  }

 private:
  bool armed() const { return state_.state == drivetrain_state_t::ARMED; }
  void command() {
    const Instant now = loop_.now();
    twist_t command{};
    command.utime = to_utime(now);
    command.run = loop_.run_id();
    command.pose_utime = -1;
    command.seq = commands_++;
    command.v_mps = now < kStart ? 0.0 : 1.0;
    command.omega_radps = now < kStart ? 0.0 : 0.3;
    publish(bus_, "AGV/CMD_VEL", command);
  }

  RealTimeLoop loop_;
  UdpmBus bus_;
  ArmOperator operator_;
  drivetrain_state_t state_{};
  bool was_armed_ = false;
  std::int64_t commands_ = 0;
  std::int64_t undecodable_ = 0;
};

struct Load {
  double bridge_percent = 0.0;
  double drives_percent = 0.0;
};

/// Load during 10 s of driving, in percent of one CPU; from CPU time, so that another load on the
/// machine hardly counts. Throws if the vehicle did not drive all the time.
Load load_while_driving(const Scenario& scenario) {
  const std::int64_t start_utime_us =
      RealTimeLoop::wall_utime_us() +
      to_utime(kStart + from_seconds(scenario.get<RunSettings>().lead_s + 0.5));
  std::array<int, 2> ends{};
  check_system_call("opening sockets", socketpair(AF_UNIX, SOCK_DGRAM, 0, ends.data()));
  const auto drives = ChildNode::start<CanDriveNode>(scenario, start_utime_us, ends[0]);
  const auto bridge = ChildNode::start<CanBridgeNode>(scenario, start_utime_us, ends[1]);
  for (const int fd : ends) close(fd);
  Driver driver(scenario, start_utime_us);

  driver.run_to(kStart + kSettle);
  driver.check_armed();
  const std::array<double, 2> before_s{bridge.cpu_seconds(), drives.cpu_seconds()};
  driver.run_to(kStart + kSettle + kWindow);
  driver.check_armed();
  const double percent = 100.0 / std::chrono::duration<double>(kWindow).count();
  return {percent * (bridge.cpu_seconds() - before_s[0]),
          percent * (drives.cpu_seconds() - before_s[1])};
}

/// A busy machine may stop the vehicle: tried again then, a few times.
Load patient_load(const Scenario& scenario) {
  for (int tries_left = kTries - 1;; --tries_left) {
    try {
      return load_while_driving(scenario);
    } catch (const std::exception& error) {
      if (tries_left == 0) throw;
      fmt::print(stderr, "once more, because {}\n", error.what());
    }
  }
}

void cpu_load(benchmark::State& state) {
  const Scenario scenario = load_scenario(
      in_source("/scenarios/hil_vcan.toml"),
      {fmt::format("can.cycle_ms={}", state.range(0)), "can.wheels=model", "can.coupling_ms=50"});
  if (bench::charges_whole_ticks()) state.SetLabel("this kernel charges whole ticks: no figure");
  for (auto unused : state) {
    (void)unused;
    const Load load = patient_load(scenario);
    state.SetIterationTime(std::chrono::duration<double>(kWindow).count());
    state.counters["bridge_percent"] = load.bridge_percent;
    state.counters["drives_percent"] = load.drives_percent;
  }
}
BENCHMARK(cpu_load)
    ->ArgName("cycle_ms")
    ->Arg(20)
    ->Arg(10)
    ->Iterations(1)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace tether

int main(int argc, char** argv) { return tether::bench::run_benchmarks(argc, argv); }
