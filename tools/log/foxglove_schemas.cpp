#include "tools/log/foxglove_schemas.hpp"

#include <initializer_list>
#include <nlohmann/json.hpp>
#include <utility>

#include "tools/base/json.hpp"
namespace tether {
namespace {

using Json = nlohmann::ordered_json;

Json kind(const char* type) { return {{"type", type}}; }

Json list_of(const Json& item) { return {{"type", "array"}, {"items", item}}; }

Json object(std::string_view title, std::initializer_list<std::pair<const char*, Json>> fields) {
  Json schema = {{"title", title}, {"type", "object"}, {"properties", Json::object()}};
  for (const auto& [name, field] : fields) {
    schema["properties"][name] = field;
    schema["required"].push_back(name);
  }
  return schema;
}

Json numbers(std::string_view title, std::initializer_list<const char*> names) {
  Json schema = object(title, {});
  for (const char* name : names) {
    schema["properties"][name] = kind("number");
    schema["required"].push_back(name);
  }
  return schema;
}

Json time(const char* title) {
  return object(title, {{"sec", kind("integer")}, {"nsec", kind("integer")}});
}

Json vector3() { return numbers("foxglove.Vector3", {"x", "y", "z"}); }
Json quaternion() { return numbers("foxglove.Quaternion", {"x", "y", "z", "w"}); }
Json color() { return numbers("foxglove.Color", {"r", "g", "b", "a"}); }
Json pose() {
  return object("foxglove.Pose", {{"position", vector3()}, {"orientation", quaternion()}});
}

Json cube() {
  return object("foxglove.CubePrimitive",
                {{"pose", pose()}, {"size", vector3()}, {"color", color()}});
}

Json sphere() {
  return object("foxglove.SpherePrimitive",
                {{"pose", pose()}, {"size", vector3()}, {"color", color()}});
}

Json cylinder() {
  return object("foxglove.CylinderPrimitive", {{"pose", pose()},
                                               {"size", vector3()},
                                               {"bottom_scale", kind("number")},
                                               {"top_scale", kind("number")},
                                               {"color", color()}});
}

Json arrow() {
  return object("foxglove.ArrowPrimitive", {{"pose", pose()},
                                            {"shaft_length", kind("number")},
                                            {"shaft_diameter", kind("number")},
                                            {"head_length", kind("number")},
                                            {"head_diameter", kind("number")},
                                            {"color", color()}});
}

Json line() {
  return object("foxglove.LinePrimitive",
                {{"type", kind("integer")},
                 {"pose", pose()},
                 {"thickness", kind("number")},
                 {"scale_invariant", kind("boolean")},
                 {"points", list_of(numbers("foxglove.Point3", {"x", "y", "z"}))},
                 {"color", color()},
                 {"colors", list_of(color())},
                 {"indices", list_of(kind("integer"))}});
}

Json entity() {
  const Json pair =
      object("foxglove.KeyValuePair", {{"key", kind("string")}, {"value", kind("string")}});
  return object("foxglove.SceneEntity",
                {{"timestamp", time("time")},
                 {"frame_id", kind("string")},
                 {"id", kind("string")},
                 {"lifetime", time("duration")},
                 {"frame_locked", kind("boolean")},
                 {"metadata", list_of(pair)},
                 {"arrows", list_of(arrow())},
                 {"cubes", list_of(cube())},
                 {"spheres", list_of(sphere())},
                 {"cylinders", list_of(cylinder())},
                 {"lines", list_of(line())},
                 {"triangles", list_of(object("foxglove.TriangleListPrimitive", {}))},
                 {"texts", list_of(object("foxglove.TextPrimitive", {}))},
                 {"models", list_of(object("foxglove.ModelPrimitive", {}))}});
}

Json scene_update() {
  return object(kSceneUpdate, {{"deletions", list_of(object("foxglove.SceneEntityDeletion", {}))},
                               {"entities", list_of(entity())}});
}

Json frame_transform() {
  return object(kFrameTransform, {{"timestamp", time("time")},
                                  {"parent_frame_id", kind("string")},
                                  {"child_frame_id", kind("string")},
                                  {"translation", vector3()},
                                  {"rotation", quaternion()}});
}

Json pose_in_frame() {
  return object(kPoseInFrame,
                {{"timestamp", time("time")}, {"frame_id", kind("string")}, {"pose", pose()}});
}

Json laser_scan() {
  return object(kLaserScan, {{"timestamp", time("time")},
                             {"frame_id", kind("string")},
                             {"pose", pose()},
                             {"start_angle", kind("number")},
                             {"end_angle", kind("number")},
                             {"ranges", list_of(kind("number"))},
                             {"intensities", list_of(kind("number"))}});
}

}  // namespace

const std::vector<FoxgloveSchema>& foxglove_schemas() {
  static const std::vector<FoxgloveSchema> kSchemas = {
      {kSceneUpdate, json_text(scene_update())},
      {kFrameTransform, json_text(frame_transform())},
      {kPoseInFrame, json_text(pose_in_frame())},
      {kLaserScan, json_text(laser_scan())}};
  return kSchemas;
}

}  // namespace tether
