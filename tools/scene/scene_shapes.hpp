#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "tools/scene/scene_setting.hpp"

namespace tether {

// Entities of a foxglove.SceneUpdate; each is complete, with all that its schema requires.

/// Floor, walls, obstacles that stand, and path, as far as they are known, in frame "world".
nlohmann::ordered_json place_entity(const SceneSetting& setting, std::int64_t time_ns);

/// An obstacle that moves, fixed to a frame of its own at its centre.
nlohmann::ordered_json moving_entity(const MovingShape& moving, const std::string& frame,
                                     std::int64_t time_ns);

/// The vehicle, or an arrow where its shape is not known, fixed to a frame at its axle's midpoint
/// on the floor. Channels of the simulator (SIM/…) are the truth and get a solid body with wheels,
/// all others, beliefs or measurements, a transparent one: orange for controllers
/// (CTRL…), green for drives (CAN…), grey for the rest.
nlohmann::ordered_json vehicle_entity(const SceneSetting& setting, const std::string& frame,
                                      std::int64_t time_ns);

}  // namespace tether
