#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "common/vehicle/pose.hpp"
#include "tools/log/laser_scan.hpp"
#include "tools/log/scene_setting.hpp"
#include "tools/messages/message_printer.hpp"

namespace tether {

/// One message for viewers.
struct ViewMessage {
  std::string_view channel;
  std::string_view schema;  ///< one of foxglove_schemas()
  std::string json;
};

// The channels of what is made for viewers.
inline constexpr std::string_view kSceneChannel = "VIEW/SCENE";          ///< SceneUpdate
inline constexpr std::string_view kFramesChannel = "VIEW/FRAMES";        ///< FrameTransform
inline constexpr std::string_view kReferenceChannel = "VIEW/REFERENCE";  ///< PoseInFrame
inline constexpr std::string_view kScanChannel = "VIEW/SCAN";            ///< LaserScan

/// Makes a run visible in Foxglove's 3D panel. Everything is in frame "world" (x forward at yaw 0,
/// z up). Each channel whose messages carry x_m, y_m and yaw_rad (SIM/TRUTH, AGV/POSE, CTRL/POSE,
/// CAN/ODOMETRY …) is a frame of that name, at the axle's midpoint on the floor, with the vehicle
/// in it. The point of the path where the vehicle should be is VIEW/REFERENCE, from SIM/TRUTH.
/// Obstacles that move are frames "moving 1" …, ten times a second of SIM/TRUTH, from the scenario.
/// VIEW/SCAN has the scans of the first vehicle that sends some, in the frame of SIM/TRUTH, else of
/// its localisation or its poses.
///
/// Each VIEW/SCENE holds the whole scene: a viewer that jumps in a file shows the newest message of
/// each channel. There is one at the first pose of each frame, and no other.
class SceneView {
 public:
  /// Channels beyond this many get no frame: anybody on the network can invent them.
  static constexpr std::size_t kMostFrames = 100;

  explicit SceneView(SceneSetting setting = {}) : setting_(std::move(setting)) {}

  /// Appends what a message adds: nothing, or a transform, with the truth its reference, and before
  /// them the scene if the frame is new. `time_ns` becomes the time stamp, ≥ 0: for a log, the
  /// log's. Poses that are not finite add nothing.
  void on_message(std::string_view channel, const MessageContent& message, std::int64_t time_ns,
                  std::vector<ViewMessage>& out);

  /// The whole scene so far, for who begins to look now.
  std::string scene_update(std::int64_t time_ns) const;

 private:
  void add_moving(std::int64_t utime, std::int64_t time_ns, std::vector<ViewMessage>& out);
  void add_scan(std::string_view channel, const LaserScan& scan, std::int64_t time_ns,
                std::vector<ViewMessage>& out);

  SceneSetting setting_;
  std::set<std::string, std::less<>> frames_;
  std::string scans_;          ///< the channel that VIEW/SCAN is made of
  std::int64_t moved_us_ = 0;  ///< time at which moving obstacles were shown last
};

/// The frame of the one of SceneSetting::moving that has this number.
std::string moving_frame(std::size_t number);

/// A foxglove.Time and a foxglove.Pose.
std::string time_json(std::int64_t time_ns);
std::string pose_json(const Pose2& pose);

/// "translation" etc. of a transform from "world" to `frame`; of a foxglove.FrameTransform.
std::string frame_transform_json(std::string_view frame, const Pose2& pose, std::int64_t time_ns);

/// A foxglove.PoseInFrame in "world".
std::string pose_in_frame_json(const Pose2& pose, std::int64_t time_ns);

/// x_m, y_m and yaw_rad of a message; nothing if it has not all of them or they are not finite.
std::optional<Pose2> pose_of(const MessageContent& message);

}  // namespace tether
