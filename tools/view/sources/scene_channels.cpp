#include "tools/view/sources/scene_channels.hpp"

#include <algorithm>
#include <utility>

#include "tools/log/foxglove_schemas.hpp"
#include "tools/log/scene_view.hpp"

namespace tether {
namespace {

class SceneChannels final : public DerivedChannels {
 public:
  explicit SceneChannels(const SceneSetting& setting) : view_(setting) {
    for (const auto& [topic, name] :
         {std::pair{kSceneChannel, kSceneUpdate}, std::pair{kFramesChannel, kFrameTransform},
          std::pair{kReferenceChannel, kPoseInFrame}, std::pair{kScanChannel, kLaserScan}}) {
      for (const FoxgloveSchema& schema : foxglove_schemas()) {
        if (schema.name != name) continue;
        channels_.push_back({std::string(topic), std::string(name), schema.json_schema});
      }
    }
  }

  const std::vector<Description>& channels() const override { return channels_; }

  bool reads(std::string_view, const MessageType& type) const override {
    if (type.name == "scan_t") return true;
    const auto& names = type.field_names;
    return std::all_of(kPose.begin(), kPose.end(), [&names](const char* field) {
      return std::find(names.begin(), names.end(), field) != names.end();
    });
  }

  void on_message(std::string_view topic, const MessageContent& message, std::uint64_t time_ns,
                  const Emit& emit) override {
    std::vector<ViewMessage> made;
    view_.on_message(topic, message, static_cast<std::int64_t>(time_ns), made);
    for (ViewMessage& one : made) {
      for (std::size_t i = 0; i < channels_.size(); ++i) {
        if (channels_[i].topic == one.channel) emit(i, std::move(one.json));
      }
    }
  }

 private:
  static constexpr std::array kPose{"x_m", "y_m", "yaw_rad"};  // fields of pose_of()

  std::vector<Description> channels_;
  SceneView view_;
};

}  // namespace

std::unique_ptr<DerivedChannels> scene_channels(const SceneSetting& setting) {
  return std::make_unique<SceneChannels>(setting);
}

}  // namespace tether
