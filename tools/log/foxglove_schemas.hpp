#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tether {

// Schemas of Foxglove's own, which its viewers (Foxglove, Lichtblick) know by name and draw:
// docs.foxglove.dev/docs/sdk/schemas. Written here as JSON Schemas of the fields that we send; the
// published ones (npm's @foxglove/schemas) accept all that we send, which a test sees to.

inline constexpr std::string_view kSceneUpdate = "foxglove.SceneUpdate";
inline constexpr std::string_view kFrameTransform = "foxglove.FrameTransform";
inline constexpr std::string_view kPoseInFrame = "foxglove.PoseInFrame";
inline constexpr std::string_view kLaserScan = "foxglove.LaserScan";

struct FoxgloveSchema {
  std::string_view name;
  std::string json_schema;  ///< one line of text
};

/// The schemas above.
const std::vector<FoxgloveSchema>& foxglove_schemas();

}  // namespace tether
