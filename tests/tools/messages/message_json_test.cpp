#include "tools/messages/message_json.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <tether/all_messages.hpp>
#include <vector>

#include "tools/messages/message_schema.hpp"

namespace tether {
namespace {

template <class LcmType>
MessageContent content_of(const LcmType& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return inspect_message(bytes);
}

const MessageType& type_named(const std::string& name) {
  for (const MessageType& type : message_types()) {
    if (type.name == name) return type;
  }
  throw std::logic_error("no type " + name);
}

nlohmann::json schema_of(const std::string& name) {
  return nlohmann::json::parse(json_schema(type_named(name)));
}

TEST(MessageJson, HasTheFieldsInTheirOrder) {
  pose_t pose{};
  pose.utime = 50'000;
  pose.seq = 1;
  pose.x_m = 0.1;
  pose.y_m = -2.0;
  pose.yaw_rad = 1e-300;
  pose.plan_id = -1;
  EXPECT_EQ(message_json(content_of(pose)),
            R"({"utime":50000,"seq":1,"run":0,"x_m":0.1,"y_m":-2,"yaw_rad":1e-300,)"
            R"("plan_session":0,"plan_id":-1})");
}

TEST(MessageJson, WritesTextArraysAndTruth) {
  counters_t counters{};
  counters.node = "si\"m\\";
  counters.count = 2;
  counters.name = {"a\n", "\xff\xc3\xa9"};
  counters.value = {7, -8};
  EXPECT_EQ(message_json(content_of(counters)),
            R"({"utime":0,"seq":0,"node":"si\"m\\","count":2,"name":["a\n",")"
            "\xef\xbf\xbd\xc3\xa9"
            R"("],"value":[7,-8]})");
  ground_truth_t truth{};
  truth.lost = 1;
  EXPECT_TRUE(message_json(content_of(truth)).ends_with(R"("lost":true,"wall_contact":false})"));
}

TEST(MessageJson, WritesFloatsAsShortAsFloatsAreAndWhatIsNoNumberAsNull) {
  plan_t plan{};
  plan.count = 3;
  plan.v_mps = {0.1F, std::numeric_limits<float>::infinity(), 2e-30F};
  plan.omega_radps = {std::numeric_limits<float>::quiet_NaN(), 0.0F, -0.0F};
  EXPECT_TRUE(message_json(content_of(plan))
                  .ends_with(R"("v_mps":[0.1,null,2e-30],"omega_radps":[null,0,-0]})"));
}

TEST(MessageJson, KeepsEveryBitOfDoublesAndIntegers) {
  for (const double x : {1.0 / 3.0, 17.045823064878373, 5e-324, 1.7976931348623157e308}) {
    std::string text;
    append_json_value(text, x);
    EXPECT_EQ(nlohmann::json::parse(text).get<double>(), x);
  }
  std::string text;
  append_json_value(text, std::numeric_limits<std::int64_t>::min());
  EXPECT_EQ(text, "-9223372036854775808");
}

TEST(JsonSchema, DescribesEveryFieldOfEveryTypeThatTheMessageHas) {
  for (const MessageType& type : message_types()) {
    const auto schema = schema_of(type.name);
    MessageContent empty;
    empty.type = &type;
    empty.values = type.empty;
    const auto message = nlohmann::json::parse(message_json(empty));
    EXPECT_EQ(schema.at("properties").size(), message.size()) << type.name;
    for (const auto& [name, value] : message.items()) {
      const std::string& kind = schema.at("properties").at(name).at("type");
      const std::string is = value.is_boolean()  ? "boolean"
                             : value.is_array()  ? "array"
                             : value.is_string() ? "string"
                                                 : "number";
      EXPECT_TRUE(kind == is || (kind == "integer" && is == "number")) << type.name << "." << name;
    }
    EXPECT_FALSE(message_note(type).empty()) << type.name;
  }
}

TEST(JsonSchema, SaysWhatTheLcmFileSays) {
  const auto pose = schema_of("pose_t");
  EXPECT_EQ(pose["title"], "tether.pose_t");
  EXPECT_EQ(pose["properties"]["x_m"]["description"], "axle midpoint, world frame [m]");
  EXPECT_EQ(pose["properties"]["x_m"]["unit"], "m");
  EXPECT_EQ(pose["properties"]["utime"]["unit"], "µs");
  const std::string session = pose["properties"]["plan_session"]["description"];
  EXPECT_TRUE(session.starts_with("The plan (plan_t) that")) << session;
  const auto state = schema_of("drivetrain_state_t")["properties"]["state"];
  EXPECT_EQ(state["oneOf"].size(), 9U);
  EXPECT_EQ(state["oneOf"][4]["title"], "ARMED");
  EXPECT_EQ(state["oneOf"][4]["const"], 4);
  EXPECT_EQ(schema_of("plan_t")["properties"]["v_mps"]["items"]["type"], "number");
}

TEST(Units, AreThoseOfTheNamesEnding) {
  EXPECT_EQ(unit_of("v_mps"), "m/s");
  EXPECT_EQ(unit_of("omega_radps"), "rad/s");
  EXPECT_EQ(unit_of("yaw_rad"), "rad");
  EXPECT_EQ(unit_of("cov_x_yaw_m_rad"), "m·rad");
  EXPECT_EQ(unit_of("cov_yaw_yaw_rad2"), "rad²");
  EXPECT_EQ(unit_of("x_ref_m"), "m");
  EXPECT_EQ(unit_of("delay_ms_p99"), "ms");
  EXPECT_EQ(unit_of("state_delay_ms"), "ms");
  EXPECT_EQ(unit_of("pose_age_s"), "s");
  EXPECT_EQ(unit_of("seq"), "");
  EXPECT_EQ(unit_of("reason"), "");
}

}  // namespace
}  // namespace tether
