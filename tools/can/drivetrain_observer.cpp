#include "tools/can/drivetrain_observer.hpp"

#include <algorithm>
#include <cmath>

#include "common/base/text.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

DrivetrainObserver::DrivetrainObserver(const Scenario& scenario, EventLoop& loop, Bus& bus)
    : loop_(loop),
      end_utime_(to_utime(kStart + from_seconds(scenario.get<RunSettings>().duration_s))),
      state_guard_({.earliest = kStart - from_seconds(scenario.get<RunSettings>().lead_s)}),
      odometry_guard_({.earliest = kStart - from_seconds(scenario.get<RunSettings>().lead_s)}),
      true_x_m_(scenario.get<VehicleSettings>().start_x_m),
      true_y_m_(scenario.get<VehicleSettings>().start_y_m) {
  const ChannelNames channels(scenario.get<VehicleSettings>().name);
  subscribe<drivetrain_state_t>(bus, channels.can_state, kDeepQueue, undecodable_,
                                [this](const drivetrain_state_t& m) { on_state(m); });
  subscribe<odometry_t>(
      bus, channels.can_odometry, kDeepQueue, undecodable_, [this](const odometry_t& m) {
        const bool usable = m.utime <= end_utime_ && is_usable(Pose2{m.x_m, m.y_m, m.yaw_rad}) &&
                            is_usable(m.distance_m);
        if (usable && odometry_guard_.accept(loop_.now(), from_utime(m.utime), m.seq)) {
          odometry_ = m;
        }
      });
  subscribe<ground_truth_t>(bus, channels.truth, kDeepQueue, undecodable_,
                            [this](const ground_truth_t& m) { on_truth(m); });
}

void DrivetrainObserver::on_state(const drivetrain_state_t& m) {
  if (m.utime > end_utime_) return;
  if (!state_guard_.accept(loop_.now(), from_utime(m.utime), m.seq)) return;
  const bool was_armed = state_.state == drivetrain_state_t::ARMED;
  const bool armed = m.state == drivetrain_state_t::ARMED;
  if (was_armed && m.utime > 0) {
    armed_s_ += static_cast<double>(m.utime - std::max<std::int64_t>(0, state_.utime)) * 1e-6;
  }
  if (was_armed && !armed) {
    stop_reason_ = printable_message(m.reason);
    stopped_at_s_ = static_cast<double>(m.utime) * 1e-6;
  }
  ever_armed_ = ever_armed_ || armed;
  state_ = m;
  // For terminals and JSON, from any sender.
  state_.state_name = printable_message(m.state_name, kLongestNameShown);
  state_.reason = printable_message(m.reason);
}

void DrivetrainObserver::on_truth(const ground_truth_t& m) {
  if (!is_usable(Pose2{m.x_m, m.y_m, m.yaw_rad})) return;
  if (!truth_guard_.accept(loop_.now(), from_utime(m.utime), m.seq)) return;
  // The first is where it really stands, which may not be its nominal start.
  if (any_truth_) true_distance_m_ += std::hypot(m.x_m - true_x_m_, m.y_m - true_y_m_);
  any_truth_ = true;
  true_x_m_ = m.x_m;
  true_y_m_ = m.y_m;
}

double DrivetrainObserver::odometry_error_m() const {
  return std::hypot(true_x_m_ - odometry_.x_m, true_y_m_ - odometry_.y_m);
}

}  // namespace tether
