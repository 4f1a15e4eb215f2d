#include "bench/live_drivetrain.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <stdexcept>
#include <tether/drive_request_t.hpp>
#include <tether/twist_t.hpp>
#include <utility>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/drivetrain/can_settings.hpp"
#include "common/base/share.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/node/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/base/process.hpp"

namespace tether::bench {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

const std::string kScenario = in_source("/scenarios/hil_vcan.toml");
constexpr milliseconds kBoot{500};  // for the processes to be there when the run begins
constexpr seconds kArmPatience{30};
constexpr milliseconds kPressPeriod{300};
constexpr milliseconds kSamplePatience{1000};
constexpr int kSampleTries = 10;
constexpr seconds kEndPatience{4};
constexpr std::size_t kLinesKept = 30;

// The left drive of drivetrains/two_node_cia402.toml.
constexpr std::uint32_t kTargetId = canopen::pdo_id(false, 1, 1);
constexpr std::size_t kTargetOffset = 2;  // behind the controlword
constexpr std::uint32_t kPositionId = canopen::pdo_id(true, 2, 1);

// Near enough to each other that the setpoint settles within 0.1 s.
constexpr double kSlow_mps = 0.95;
constexpr double kFast_mps = 1.0;

std::string text(double value) { return fmt::format("{:g}", value); }

}  // namespace

LiveDrivetrain::LiveDrivetrain(double cycle_ms)
    : scenario_(load_scenario(kScenario, {"can.cycle_ms=" + text(cycle_ms)})),
      cycle_ms_(cycle_ms),
      start_utime_us_(RealTimeLoop::wall_utime_us() +
                      to_utime(kStart + kBoot + from_seconds(scenario_.get<RunSettings>().lead_s))),
      loop_(start_utime_us_),
      bus_(kDefaultLcmUrl, loop_),
      tap_(scenario_.get<CanSettings>().interface, {kTargetId, kPositionId}) {
  subscribe<drivetrain_state_t>(bus_, "CAN/STATE", kDeepQueue, undecodable_,
                                [this](const drivetrain_state_t& m) { on_state(m); });
  subscribe<wheel_feedback_t>(bus_, "CAN/WHEELS", kDeepQueue, undecodable_,
                              [this](const wheel_feedback_t& m) { on_wheels(m); });
  loop_.add_fd(tap_.fd(), [this](Instant) {
    while (const auto frame = tap_.receive(0)) on_frame(*frame);
  });
  drive_ = node("tether-can-drive");
  bridge_ = node("tether-can-bridge");
  schedule_command();
}

std::unique_ptr<NodeProcess> LiveDrivetrain::node(const std::string& program) {
  const std::string file = (executable_folder() / program).string();
  std::vector<std::string> command{file,
                                   kScenario,
                                   fmt::format("--lcm-url={}", kDefaultLcmUrl),
                                   fmt::format("--start-utime={}", start_utime_us_),
                                   "--set=can.wheels=model",
                                   "--set=can.coupling_ms=50",
                                   fmt::format("--set=can.cycle_ms={}", text(cycle_ms_))};
  auto process = std::make_unique<NodeProcess>(
      loop_, std::move(command),
      [this](const std::string& line) {
        said_.push_back(line);
        if (said_.size() > kLinesKept) said_.pop_front();
      },
      [this, program](int code) {
        if (!ending_) failure_ = fmt::format("{} ended (exit code {})", program, code);
        loop_.stop();
      });
  process->start();
  return process;
}

void LiveDrivetrain::run_for(Duration time) {
  loop_.run_until(loop_.now() + time);
  if (loop_.signal() != 0) failure_ = "interrupted";
  if (!failure_.empty()) {
    throw std::runtime_error(fmt::format("{}\n{}", failure_, fmt::join(said_, "\n")));
  }
}

LiveDrivetrain::Traffic LiveDrivetrain::drive_for(Duration time) {
  const CanTap everything(scenario_.get<CanSettings>().interface);
  const Instant end = loop_.now() + time;
  Traffic sum;
  while (loop_.now() < end) {
    ensure_armed();
    const std::int64_t start_ns = wall_ns();
    run_for(milliseconds{100});
    const std::int64_t end_ns = wall_ns();
    Traffic slice{0, 0, static_cast<double>(end_ns - start_ns) * 1e-9};
    while (const auto stamped = everything.receive(0)) {
      if (stamped->wall_ns < start_ns || stamped->wall_ns >= end_ns) continue;
      ++slice.frames;
      slice.bits += 55 + 10 * stamped->frame.size;
    }
    if (armed()) sum += slice;
  }
  return sum;
}

void LiveDrivetrain::ensure_armed() {
  if (armed()) return;
  steering_ = false;
  const Instant deadline = loop_.now() + kArmPatience;
  while (!armed()) {
    if (loop_.now() > deadline) {
      throw std::runtime_error(fmt::format("the drivetrain could not be armed, it is {}: {}\n{}",
                                           state_.state_name, state_.reason,
                                           fmt::join(said_, "\n")));
    }
    press();
    run_for(milliseconds{20});
  }
  run_for(milliseconds{200});  // still at standstill: what it reports is what the drive has
  if (positions_.empty()) throw std::runtime_error("no TPDO2 from the left drive");
  counts_offset_ = reported_counts_ - positions_.back().counts;
  steering_ = true;
}

void LiveDrivetrain::press() {
  const Instant now = loop_.now();
  if (now - last_press_ < kPressPeriod) return;
  drive_request_t request{};
  if (state_.state == drivetrain_state_t::DISARMED) {
    request.request = drive_request_t::ARM;
  } else if (state_.state == drivetrain_state_t::FAULT ||
             state_.state == drivetrain_state_t::REFUSED) {
    request.request = drive_request_t::RESET;
  } else {
    return;
  }
  last_press_ = now;
  request.utime = to_utime(now);
  request.run = loop_.run_id();
  request.seq = requests_++;
  publish(bus_, "CAN/REQUEST", request);
}

void LiveDrivetrain::schedule_command() {
  std::uniform_real_distribution<double> gap_s(0.010, 0.030);
  loop_.at(loop_.now() + from_seconds(gap_s(random_)), Priority::node, [this](Instant) {
    send_command();
    schedule_command();
  });
}

void LiveDrivetrain::send_command() {
  const bool moving = steering_ && armed();
  if (!moving) {
    v_mps_ = 0.0;
    command_sent_ns_.reset();
  } else if (v_mps_ == 0.0) {
    v_mps_ = kSlow_mps;
  } else if (command_wanted_ && !command_sent_ns_ && std::abs(state_.v_mps - v_mps_) < 1e-9) {
    v_mps_ = v_mps_ == kSlow_mps ? kFast_mps : kSlow_mps;
    settled_target_ = target_;
    command_sent_ns_ = wall_ns();
  }
  twist_t command{};
  command.utime = to_utime(loop_.now());
  command.run = loop_.run_id();
  command.pose_utime = -1;
  command.seq = commands_++;
  command.v_mps = v_mps_;
  publish(bus_, "AGV/CMD_VEL", command);
}

void LiveDrivetrain::on_state(const drivetrain_state_t& state) {
  const drivetrain_state_t previous = std::exchange(state_, state);
  if (previous.state == drivetrain_state_t::ARMED && !armed() && !ending_) ++stops_[state_.reason];
}

void LiveDrivetrain::on_frame(const StampedFrame& stamped) {
  const CanFrame& frame = stamped.frame;
  if (frame.id == kTargetId && frame.size >= kTargetOffset + 4) {
    target_ = canopen::read_integer(frame.data.data() + kTargetOffset, 4, true);
    if (command_sent_ns_ && target_ != settled_target_ && stamped.wall_ns > *command_sent_ns_) {
      command_sample_ns_ = stamped.wall_ns - *command_sent_ns_;
      command_sent_ns_.reset();
      command_wanted_ = false;
      loop_.stop();
    }
  } else if (frame.id == kPositionId && frame.size >= 4) {
    const std::int64_t counts = canopen::read_integer(frame.data.data(), 4, true);
    if (!positions_.empty() && positions_.back().counts == counts) return;
    positions_.push_back({counts, stamped.wall_ns});
    if (positions_.size() > 64) positions_.pop_front();
  }
}

void LiveDrivetrain::on_wheels(const wheel_feedback_t& wheels) {
  const std::int64_t now_ns = wall_ns();
  if (std::exchange(reported_counts_, wheels.left_position_counts) == wheels.left_position_counts ||
      !report_wanted_) {
    return;
  }
  // The frame may still wait in the tap's socket.
  while (const auto frame = tap_.receive(0)) on_frame(*frame);
  const auto found = std::find_if(positions_.rbegin(), positions_.rend(), [&](const Position& p) {
    return p.counts + counts_offset_ == wheels.left_position_counts;
  });
  if (found == positions_.rend()) return;
  report_sample_ns_ = now_ns - found->wall_ns;
  report_wanted_ = false;
  loop_.stop();
}

std::int64_t LiveDrivetrain::next(std::optional<std::int64_t>& sample, bool& wanted,
                                  const std::string& what) {
  for (int i = 0; i < kSampleTries; ++i) {
    ensure_armed();
    sample.reset();
    wanted = true;
    const Instant deadline = loop_.now() + kSamplePatience;
    while (!sample && armed() && loop_.now() < deadline) run_for(deadline - loop_.now());
    wanted = false;
    if (sample) return *sample;
    command_sent_ns_.reset();
  }
  throw std::runtime_error(fmt::format("{}: nothing measured in {} tries; the drivetrain is {}: {}",
                                       what, kSampleTries, state_.state_name, state_.reason));
}

std::int64_t LiveDrivetrain::command_to_frame_ns() {
  return next(command_sample_ns_, command_wanted_, "command to frame");
}

std::int64_t LiveDrivetrain::frame_to_report_ns() {
  return next(report_sample_ns_, report_wanted_, "frame to CAN/WHEELS");
}

void LiveDrivetrain::stop(NodeProcess& process) {
  const Instant deadline = loop_.now() + kEndPatience;
  process.send_signal(SIGTERM);
  while (process.running() && loop_.now() < deadline) loop_.run_until(deadline);
}

void LiveDrivetrain::end() {
  ending_ = true;
  stop(*bridge_);
  stop(*drive_);
}

}  // namespace tether::bench
