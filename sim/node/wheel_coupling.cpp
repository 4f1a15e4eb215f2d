#include "sim/node/wheel_coupling.hpp"

#include <tether/wheel_states_t.hpp>
#include <tether/wheel_targets_t.hpp>

#include "common/bus/channel_names.hpp"
#include "common/bus/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

WheelCoupling::WheelCoupling(const Sections<RunSettings, VehicleSettings>& settings,
                             EventLoop& loop, Bus& bus, const Plant& vehicle)
    : loop_(loop),
      bus_(bus),
      vehicle_(vehicle),
      wheel_radius_m_(settings.get<VehicleSettings>().wheel_radius_m),
      guard_({.earliest = kStart - from_seconds(settings.get<RunSettings>().lead_s)}) {
  const ChannelNames channels(settings.get<VehicleSettings>().name);
  states_channel_ = channels.wheel_states;
  subscribe<wheel_targets_t>(
      bus, channels.wheel_targets, kDeepQueue, undecodable_, [this](const wheel_targets_t& m) {
        if (!is_usable(m.left_speed_radps) || !is_usable(m.right_speed_radps)) {
          ++non_finite_;
          return;
        }
        if (!guard_.accept(loop_.now(), from_utime(m.utime), m.seq)) return;
        targets_ = {m.left_speed_radps * wheel_radius_m_, m.right_speed_radps * wheel_radius_m_};
        arrival_ = loop_.now();
        any_ = true;
      });
}

WheelSpeeds WheelCoupling::in_force(Instant now) const {
  return any_ && now - arrival_ < kTimeout ? targets_ : WheelSpeeds{};
}

void WheelCoupling::publish_wheels(Instant now) {
  const VehicleState s = vehicle_.state();
  wheel_states_t message{};
  message.utime = to_utime(now);
  message.seq = seq_++;
  message.left_angle_rad = s.left_wheel_angle_rad;
  message.right_angle_rad = s.right_wheel_angle_rad;
  message.left_speed_radps = s.rim_speeds.left_mps / wheel_radius_m_;
  message.right_speed_radps = s.rim_speeds.right_mps / wheel_radius_m_;
  publish(bus_, states_channel_, message);
}

void WheelCoupling::list(CounterList& out) const {
  guard_.list("wheel_targets", out);
  out.emplace_back("wheel_targets.undecodable", undecodable_);
  out.emplace_back("wheel_targets.non_finite", non_finite_);
}

}  // namespace tether
