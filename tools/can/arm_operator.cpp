#include "tools/can/arm_operator.hpp"

#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

ArmOperator::ArmOperator(const Scenario& scenario, EventLoop& loop, Bus& bus)
    : loop_(loop),
      bus_(bus),
      guard_({.earliest = kStart - from_seconds(scenario.get<RunSettings>().lead_s)}),
      last_press_(loop.now() - kPatience) {
  if (scenario.get<VehicleSettings>().drivetrain != VehicleSettings::Drivetrain::can ||
      scenario.get<CanSettings>().arm != CanSettings::Arm::once) {
    return;
  }
  const ChannelNames channels(scenario.get<VehicleSettings>().name);
  request_channel_ = channels.can_request;
  subscribe<drivetrain_state_t>(bus, channels.can_state, 1, undecodable_,
                                [this](const drivetrain_state_t& m) {
                                  if (guard_.accept(loop_.now(), from_utime(m.utime), m.seq)) {
                                    on_state(m.state);
                                  }
                                });
}

void ArmOperator::on_state(std::int32_t state) {
  if (state == drivetrain_state_t::ARMED) done_ = true;
  const Instant now = loop_.now();
  if (done_ || state != drivetrain_state_t::DISARMED || now - last_press_ < kPatience) return;
  last_press_ = now;
  drive_request_t request{};
  request.utime = to_utime(now);
  request.seq = seq_++;
  request.run = loop_.run_id();
  request.request = drive_request_t::ARM;
  publish(bus_, request_channel_, request);
}

}  // namespace tether
