#pragma once

#include <memory>

#include "tools/log/scene_setting.hpp"
#include "tools/view/server/derived.hpp"

namespace tether {

/// VIEW/SCENE, VIEW/FRAMES and VIEW/REFERENCE of SceneView, as channels of the server.
std::unique_ptr<DerivedChannels> scene_channels(const SceneSetting& setting);

}  // namespace tether
