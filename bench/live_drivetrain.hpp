#pragma once

#include <sys/types.h>

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <tether/drivetrain_state_t.hpp>
#include <tether/wheel_feedback_t.hpp>

#include "bench/can_tap.hpp"
#include "can_bridge/drivetrain/can_settings.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/nodes/node_process.hpp"

namespace tether::bench {

/// tether-can-bridge and tether-can-drive (with wheels of its own) as processes, on
/// scenarios/hil_vcan.toml's interface and the default LCM network; and this process, which arms
/// and commands them and looks at both networks.
///
/// Commands go out every 10 to 30 ms, at random, so that they fall anywhere into the control cycle.
/// Everything throws std::runtime_error, with what the processes wrote, if the drivetrain cannot be
/// armed or a process ends.
class LiveDrivetrain {
 public:
  /// Frames on the bus, and their bits at worst-case stuffing (see
  /// can_bridge/bus/in_process_can.hpp).
  struct Traffic {
    std::int64_t frames = 0;
    std::int64_t bits = 0;
    double elapsed_s = 0.0;

    Traffic& operator+=(const Traffic& other) {
      frames += other.frames;
      bits += other.bits;
      elapsed_s += other.elapsed_s;
      return *this;
    }
  };

  explicit LiveDrivetrain(double cycle_ms);
  LiveDrivetrain(const LiveDrivetrain&) = delete;
  LiveDrivetrain& operator=(const LiveDrivetrain&) = delete;

  /// Arms, or arms again after the bridge has stopped; both by request and zero commands.
  void ensure_armed();

  /// The next latency of a command, in ns: from publishing a command that differs from the settled
  /// setpoint to the kernel's stamp of the first RPDO1 of the left drive with another target.
  std::int64_t command_to_frame_ns();

  /// The next latency of feedback, in ns: from the kernel's stamp of a TPDO2 of the left drive with
  /// a new position to the arrival here of the CAN/WHEELS that reports it.
  std::int64_t frame_to_report_ns();

  /// Lets it drive at constant speed for `time` all in all, and arms it again when it has stopped.
  /// Returns what was on the bus while it drove.
  Traffic drive_for(Duration time);

  /// Stops the bridge in good order, then the drives.
  void end();

  double bit_rate_bps() const { return scenario_.get<CanSettings>().bit_rate_bps; }
  pid_t bridge_pid() const { return bridge_->pid(); }
  pid_t drive_pid() const { return drive_->pid(); }
  /// Why it stopped by itself, and how often.
  const std::map<std::string, int>& stops() const { return stops_; }

 private:
  struct Position {
    std::int64_t counts;
    std::int64_t wall_ns;
  };

  std::unique_ptr<NodeProcess> node(const std::string& program);
  void stop(NodeProcess& process);
  void run_for(Duration time);
  std::int64_t next(std::optional<std::int64_t>& sample, bool& wanted, const std::string& what);

  bool armed() const { return state_.state == drivetrain_state_t::ARMED; }
  void press();
  void schedule_command();
  void send_command();
  void on_state(const drivetrain_state_t& state);
  void on_wheels(const wheel_feedback_t& wheels);
  void on_frame(const StampedFrame& frame);

  Scenario scenario_;
  double cycle_ms_;
  std::int64_t start_utime_us_;
  RealTimeLoop loop_;
  UdpmBus bus_;
  CanTap tap_;
  std::mt19937 random_{1};
  std::deque<std::string> said_;
  std::string failure_;
  bool ending_ = false;

  drivetrain_state_t state_{};
  Instant last_press_{};
  std::int64_t requests_ = 0;
  std::map<std::string, int> stops_;
  bool steering_ = false;
  double v_mps_ = 0.0;
  std::int64_t commands_ = 0;
  std::int64_t undecodable_ = 0;

  bool command_wanted_ = false;
  std::optional<std::int64_t> command_sent_ns_;  // the one whose effect is waited for
  std::int64_t settled_target_ = 0;
  std::int64_t target_ = 0;
  std::optional<std::int64_t> command_sample_ns_;

  bool report_wanted_ = false;
  std::deque<Position> positions_;  // newest last
  std::int64_t reported_counts_ = 0;
  std::int64_t counts_offset_ = 0;  // reported by the bridge, over the drive's own
  std::optional<std::int64_t> report_sample_ns_;

  std::unique_ptr<NodeProcess> drive_;
  std::unique_ptr<NodeProcess> bridge_;
};

}  // namespace tether::bench
