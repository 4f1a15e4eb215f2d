#pragma once

#include <cstdint>
#include <optional>
#include <tether/localisation_t.hpp>
#include <tether/odometry_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/scan_t.hpp>
#include <tether/twist_t.hpp>

#include "common/node/bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/counter_reporter.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/message_io.hpp"
#include "common/node/node.hpp"
#include "common/node/sole_sender.hpp"
#include "common/node/stream_guard.hpp"
#include "common/world/surroundings.hpp"
#include "onboard/autonomy/onboard_driver.hpp"

namespace tether {

/// The scenario sections that the node uses.
using AutonomyNodeSettings = OnboardSettings;

/// On the vehicle: AGV/SCAN, AGV/ODOMETRY, AGV/POSE, AGV/LOCALISATION and, of a remote driver,
/// AGV/CMD_VEL and AGV/PLAN in; AGV/DRIVE out at autonomy.rate_hz, which alone moves the wheels,
/// and AGV/AUTONOMY every kReportPeriod and whenever the state changes. It only translates:
/// OnboardDriver drives.
///
/// Setpoints are zero before t = 0. From the run's beginning on (t = −run.lead_s) it looks: a lead
/// of clear_for_s and a few scans lets it start in time.
///
/// Messages that are undecodable, of another run, not finite, duplicated, late or from the future
/// are counted and otherwise ignored; they refresh nothing.
class AutonomyNode final : public Node {
 public:
  static constexpr Duration kReportPeriod = std::chrono::milliseconds{100};

  AutonomyNode(const AutonomyNodeSettings& settings, EventLoop& loop, Bus& bus);

  /// Publishes the final report and counters.
  void finish() override;

 private:
  /// An input's guard and counters.
  struct Input {
    explicit Input(Instant earliest) : guard({.earliest = earliest}) {}
    StreamGuard guard;
    Rejected rejected;
    std::int64_t unusable = 0;

    void list(const std::string& name, CounterList& out) const;
  };

  void subscribe_to_senses();
  void subscribe_to_remote();
  void on_scan(const scan_t& message);
  void on_odometry(const odometry_t& message);
  void on_pose(const pose_t& message);
  void on_command(const twist_t& message);
  void step();
  void report(Instant now);
  Instant vehicle_time() const { return loop_.now() + clock_offset_; }
  void list_counters(CounterList& out) const;

  EventLoop& loop_;
  Bus& bus_;
  ChannelNames channels_;
  SoleSender senders_;
  Duration clock_offset_;  ///< the vehicle's clock is ahead by this
  OnboardDriver driver_;
  SightedPoints sighted_;

  Input scan_, odometry_, pose_, localisation_;
  Rejected rejected_commands_, rejected_plans_;
  std::int64_t unusable_commands_ = 0;

  OnboardDriver::Output last_;
  std::int64_t steps_ = 0;
  std::int64_t reports_ = 0;
  std::optional<Instant> reported_;
  CounterReporter counters_;
};

}  // namespace tether
