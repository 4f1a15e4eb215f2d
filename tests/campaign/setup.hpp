#pragma once

#include "can_bridge/node/can_bridge_node.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "tests/campaign/record.hpp"

namespace tether::campaign {

/// State that all trials share; read once.
struct Setup {
  BridgeSettings settings;
  DrivetrainConfig drivetrain;
};
/// scenarios/hil_vcan.toml with wheels of the drives' own, its drivetrain, and no lead.
Setup load_setup();

/// The drives of a trial, that coast and brake as it says.
DrivetrainConfig drivetrain_of(const Setup& setup, const Trial& trial);

/// Settings of a trial's bridge, and those that rules use.
BridgeSettings settings_of(const Setup& setup, const Trial& trial);
Limits limits_of(const BridgeSettings& settings);

}  // namespace tether::campaign
