#include "doors/ros2/node/ros2_node.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <tether/twist_t.hpp>

#include "common/base/say.hpp"
#include "common/fleet/fleet.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/onboard_settings.hpp"

namespace tether {
namespace {

constexpr Duration kClockPeriod = std::chrono::milliseconds{10};

bool keeps_simulated_time(const Scenario& scenario, const EventLoop& loop) {
  return loop.rate() == 0.0 || scenario.get<Ros2Settings>().sim_time;
}

Ros2VehicleDoor::Time time_of(const Scenario& scenario, const EventLoop& loop) {
  const auto& settings = scenario.get<Ros2Settings>();
  const bool has_clock = keeps_simulated_time(scenario, loop);
  Ros2VehicleDoor::Time time{has_clock ? 0 : loop.run_id() * 1000, std::nullopt, has_clock};
  if (loop.rate() == 0.0) time.waited = from_seconds(settings.answer_patience_s);
  return time;
}

DdsBus::Settings dds_settings(const Scenario& scenario) {
  const auto& settings = scenario.get<Ros2Settings>();
  return {settings.domain, settings.range == Ros2Settings::Range::subnet};
}

}  // namespace

Ros2VehicleDoor::Ros2VehicleDoor(const Scenario& scenario, EventLoop& loop, Bus& bus, DdsBus& dds,
                                 const std::string& name_space, const Time& time)
    : loop_(loop),
      bus_(bus),
      dds_(dds),
      channels_(scenario.get<VehicleSettings>().name),
      time_(time),
      topics_(name_space, time.shift_ns),
      gate_({topics_.base_frame(), from_seconds(scenario.get<Ros2Settings>().max_age_s),
             time.shift_ns}),
      pose_guard_({.earliest = earliest_stamp(scenario)}),
      odometry_guard_({.earliest = earliest_stamp(scenario)}),
      scans_(from_seconds(1e-3 * scenario.get<LocaliserSettings>().scan_patience_ms)),
      twist_(dds.subscribe(topics_.topic("cmd_vel"), kRosTwist)),
      twist_stamped_(dds.subscribe(topics_.topic("cmd_vel"), kRosTwistStamped)),
      counters_(loop, bus, "ros2", channels_.control_counters,
                from_seconds(scenario.get<RunSettings>().report_period_s),
                [this](CounterList& out) { list_counters(out); }) {
  for (const auto& [name, type] :
       {std::pair{"pose", kRosPoseStamped}, std::pair{"odom", kRosOdometry},
        std::pair{"scan", kRosLaserScan}, std::pair{"tf", kRosTf},
        std::pair{"tf_static", kRosTf}}) {
    dds.advertise(topics_.topic(name), type);
  }
  subscribe_in_run<pose_t>(bus, loop, channels_.control_pose, 1, rejected_,
                           [this](const pose_t& m) { on_pose(m); });
  subscribe<odometry_t>(bus, channels_.control_odometry, kDeepQueue, undecodable_,
                        [this](const odometry_t& m) { on_odometry(m); });
  subscribe_in_run<scan_part_t>(bus, loop, channels_.control_scan_part, kDeepQueue, rejected_,
                                [this](const scan_part_t& m) { on_scan_part(m); });
}

void Ros2VehicleDoor::publish(std::vector<RosMessage> messages) {
  for (RosMessage& message : messages) dds_.publish(std::move(message));
}

void Ros2VehicleDoor::on_pose(const pose_t& m) {
  const Pose2 pose{m.x_m, m.y_m, m.yaw_rad};
  const Instant stamp = from_utime(m.utime);
  if (!is_usable(pose)) {
    ++non_finite_;
    return;
  }
  if (!pose_guard_.accept(loop_.now(), stamp, m.seq)) return;
  pose_stamp_ = stamp;
  publish(topics_.on_pose(stamp, pose));
  if (!time_.waited) return;
  // Last, so that a node whose clock has reached this instant knows what was measured by then.
  dds_.publish({"/clock", kRosClock, clock_cdr((loop_.now() - kStart).count())});
  wait_for_answer(stamp);
}

void Ros2VehicleDoor::on_odometry(const odometry_t& m) {
  const VehicleTopics::Odometry odometry{from_utime(m.utime),
                                         {m.x_m, m.y_m, m.yaw_rad},
                                         {m.cov_x_x_m2, m.cov_x_y_m2, m.cov_x_yaw_m_rad,
                                          m.cov_y_y_m2, m.cov_y_yaw_m_rad, m.cov_yaw_yaw_rad2},
                                         {m.v_mps, m.omega_radps}};
  const bool usable = is_usable(odometry.pose) && is_usable(odometry.twist) &&
                      std::all_of(odometry.covariance.begin(), odometry.covariance.end(),
                                  [](double x) { return is_usable(x); });
  if (!usable) {
    ++non_finite_;
  } else if (odometry_guard_.accept(loop_.now(), odometry.stamp, m.seq)) {
    publish(topics_.on_odometry(odometry));
  }
}

void Ros2VehicleDoor::on_scan_part(const scan_part_t& m) {
  constexpr Duration kMostAhead = std::chrono::seconds{1};
  if (from_utime(m.utime) > loop_.now() + kMostAhead) return;
  if (const auto scan = scans_.add(m)) publish_scan(*scan);
  if (const auto deadline = scans_.deadline()) {
    loop_.at(std::max(*deadline, loop_.now()), Priority::node, [this](Instant) {
      if (const auto scan = scans_.overdue(loop_.now())) publish_scan(*scan);
    });
  }
}

void Ros2VehicleDoor::publish_scan(const Scan& scan) { publish(topics_.on_scan(scan)); }

void Ros2VehicleDoor::wait_for_answer(Instant stamp) {
  using Clock = std::chrono::steady_clock;
  const auto end = Clock::now() + *time_.waited;
  answered_until_.reset();
  while (!answered_until_ || *answered_until_ < stamp) {
    const auto rest = end - Clock::now();
    if (rest <= rest.zero() || !dds_.wait(std::chrono::duration_cast<Duration>(rest))) {
      ++unanswered_;
      return;
    }
    for (const DdsBus::Received& received : dds_.take()) take(received);
  }
}

bool Ros2VehicleDoor::take(const DdsBus::Received& received) {
  const bool is_stamped = received.subscription == twist_stamped_;
  if (!is_stamped && received.subscription != twist_) return false;
  const Instant now = loop_.now();
  const auto command = is_stamped ? read_twist_stamped(received.cdr) : read_twist(received.cdr);
  const auto twist = gate_.take(now, received.publisher, command);
  if (gate_.several(now) && !is_several_known_) {
    say(Severity::warning,
        fmt::format("tether-ros2: {}: several publishers send, so that none is heard; one is {}",
                    topics_.topic("cmd_vel"), dds_.name(received)));
  }
  is_several_known_ = gate_.several(now);
  if (!twist) return true;
  answered_until_ =
      command->header
          ? kStart + std::chrono::nanoseconds{command->header->stamp_ns - time_.shift_ns}
          : now;
  twist_t out{};
  out.utime = to_utime(now);
  out.seq = sent_++;
  out.run = loop_.run_id();
  out.pose_utime = pose_stamp_ ? to_utime(*pose_stamp_) : -1;
  out.v_mps = twist->v_mps;
  out.omega_radps = twist->omega_radps;
  tether::publish(bus_, channels_.control_command, out);
  return true;
}

void Ros2VehicleDoor::list_counters(CounterList& out) const {
  pose_guard_.list("pose", out);
  rejected_.list("pose", out);
  odometry_guard_.list("odometry", out);
  out.emplace_back("odometry.undecodable", undecodable_);
  out.emplace_back("input.non_finite", non_finite_);
  gate_.list(out);
  if (time_.waited) out.emplace_back("ros2.unanswered", unanswered_);
  out.emplace_back("ros2.dropped", dds_.dropped());
  out.emplace_back("command.sent", sent_);
}

Ros2Node::Ros2Node(const Scenario& scenario, EventLoop& loop, Bus& bus)
    : loop_(loop), dds_(dds_settings(scenario)) {
  const Ros2VehicleDoor::Time time = time_of(scenario, loop);
  const std::vector<Scenario> members = fleet_members(scenario);
  if (time.has_clock) dds_.advertise("/clock", kRosClock);
  for (const Scenario& member : members) {
    const std::string& vehicle = member.get<VehicleSettings>().name;
    vehicles_.emplace_back(member, loop, bus, dds_, ros2_namespace(vehicle, members.size() == 1),
                           time);
  }
  if (loop.rate() == 0.0) return;
  loop.add_fd(dds_.fd(), [this](Instant) { drain(); });
  if (!time.has_clock) return;
  loop.every(kStart, kClockPeriod, Priority::observer, [this](Instant now) {
    dds_.publish({"/clock", kRosClock, clock_cdr((now - kStart).count())});
  });
}

Ros2Node::~Ros2Node() {
  if (loop_.rate() != 0.0) loop_.remove_fd(dds_.fd());
}

void Ros2Node::drain() {
  for (const DdsBus::Received& received : dds_.take()) {
    for (Ros2VehicleDoor& vehicle : vehicles_) {
      if (vehicle.take(received)) break;
    }
  }
  for (const std::string& line : dds_.notices()) say(Severity::warning, "tether-ros2: " + line);
}

void Ros2Node::finish() {
  for (Ros2VehicleDoor& vehicle : vehicles_) vehicle.finish();
}

}  // namespace tether
