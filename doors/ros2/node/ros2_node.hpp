#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <tether/odometry_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/scan_part_t.hpp>
#include <vector>

#include "common/node/bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/counter_reporter.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/message_io.hpp"
#include "common/node/node.hpp"
#include "common/node/stream_guard.hpp"
#include "common/scenario/scenario.hpp"
#include "common/world/scan.hpp"
#include "doors/ros2/command_gate.hpp"
#include "doors/ros2/node/dds_bus.hpp"
#include "doors/ros2/ros2_settings.hpp"
#include "doors/ros2/vehicle_topics.hpp"

namespace tether {

/// tether-ros2 in the controller's place, for one vehicle: what arrives of its poses, odometry and
/// scans goes out to ROS 2, and commands on its cmd_vel become CTRL/CMD_VEL.
class Ros2VehicleDoor {
 public:
  struct Time {
    std::int64_t shift_ns;           ///< added to all stamps
    std::optional<Duration> waited;  ///< simulated time: maximum wait for the answer to a pose
    bool has_clock;
  };

  Ros2VehicleDoor(const Scenario& scenario, EventLoop& loop, Bus& bus, DdsBus& dds,
                  const std::string& name_space, const Time& time);

  /// Takes what came on this vehicle's cmd_vel; false if it is another topic's.
  bool take(const DdsBus::Received& received);
  void finish() { counters_.publish_now(); }

 private:
  void on_pose(const pose_t& message);
  void on_odometry(const odometry_t& message);
  void on_scan_part(const scan_part_t& message);
  void wait_for_answer(Instant stamp);
  void publish_scan(const Scan& scan);
  void publish(std::vector<RosMessage> messages);
  void list_counters(CounterList& out) const;

  EventLoop& loop_;
  Bus& bus_;
  DdsBus& dds_;
  ChannelNames channels_;
  Time time_;
  VehicleTopics topics_;
  CommandGate gate_;
  StreamGuard pose_guard_, odometry_guard_;
  Rejected rejected_;
  ScanAssembly scans_;
  std::size_t twist_, twist_stamped_;
  std::optional<Instant> pose_stamp_;      ///< the newest pose's
  std::optional<Instant> answered_until_;  ///< the newest stamp that a command answers
  std::int64_t sent_ = 0, unanswered_ = 0, undecodable_ = 0, non_finite_ = 0;
  bool is_several_known_ = false;
  CounterReporter counters_;
};

/// The door of all vehicles of a run: one participant, one /clock.
class Ros2Node final : public Node {
 public:
  Ros2Node(const Scenario& scenario, EventLoop& loop, Bus& bus);
  ~Ros2Node() override;
  void finish() override;

 private:
  void drain();

  EventLoop& loop_;
  DdsBus dds_;
  std::deque<Ros2VehicleDoor> vehicles_;
};

}  // namespace tether
