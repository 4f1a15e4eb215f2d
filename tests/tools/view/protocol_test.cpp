#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/view/server/client_message.hpp"
#include "tools/view/server/server_message.hpp"

namespace tether {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Json = nlohmann::json;

template <class Kind>
Kind parsed(const std::string& text) {
  const ClientMessage message = parse_client_text(text);
  if (const auto* nonsense = std::get_if<ClientNonsense>(&message)) {
    ADD_FAILURE() << text << ": " << nonsense->reason;
  }
  return std::get<Kind>(message);
}

std::string why_nonsense(const std::string& text) {
  const ClientMessage message = parse_client_text(text);
  const auto* nonsense = std::get_if<ClientNonsense>(&message);
  return nonsense == nullptr ? "" : nonsense->reason;
}

// The examples of docs/spec.md of foxglove/ws-protocol, as it writes the fields.

TEST(ViewProtocol, DataBeginWithOpcodeSubscriptionAndTimeInLittleEndian) {
  EXPECT_THAT(data_header(0x01020304, 0x1112131415161718),
              ElementsAre(1, 4, 3, 2, 1, 0x18, 0x17, 0x16, 0x15, 0x14, 0x13, 0x12, 0x11));
  EXPECT_THAT(time_message(0x1112131415161718),
              ElementsAre(2, 0x18, 0x17, 0x16, 0x15, 0x14, 0x13, 0x12, 0x11));
}

TEST(ViewProtocol, AChannelIsAdvertisedWithItsSchema) {
  const AdvertisedChannel channel{7, "AGV/POSE", "tether.pose_t", R"({"type":"object"})"};
  EXPECT_EQ(Json::parse(advertise_message({&channel, 1})),
            Json::parse(R"({"op":"advertise","channels":[{"id":7,"topic":"AGV/POSE",
                "encoding":"json","schemaName":"tether.pose_t",
                "schema":"{\"type\":\"object\"}","schemaEncoding":"jsonschema"}]})"));
}

TEST(ViewProtocol, ParametersThatAreNotSetHaveNoValueAndNumbersSayThatTheyAre) {
  const std::vector<Parameter> parameters{
      {"a", 0.5}, {"b", true}, {"c", "markov"}, {"d", std::nullopt}, {"e", std::vector{1.0, 2.5}}};
  EXPECT_EQ(Json::parse(parameter_values_message(parameters, "r1")),
            Json::parse(R"({"op":"parameterValues","id":"r1","parameters":[
                {"name":"a","value":0.5,"type":"float64"},{"name":"b","value":true},
                {"name":"c","value":"markov"},{"name":"d"},
                {"name":"e","value":[1,2.5],"type":"float64_array"}]})"));
  EXPECT_FALSE(Json::parse(parameter_values_message(parameters, std::nullopt)).contains("id"));
}

TEST(ViewProtocol, TextThatIsNoUtf8StaysValidJson) {
  const std::string text = status_message(StatusLevel::error, "\xff\xfe");
  EXPECT_EQ(Json::parse(text)["level"], 2);
}

TEST(ViewProtocol, SubscriptionsAreReadInTheirOrder) {
  const auto message = parsed<ClientSubscribe>(
      R"({"op":"subscribe","subscriptions":[{"id":0,"channelId":3},{"id":4294967295,"channelId":5}]})");
  ASSERT_EQ(message.subscriptions.size(), 2);
  EXPECT_EQ(message.subscriptions[0].channel, 3);
  EXPECT_EQ(message.subscriptions[1].id, 4294967295);
}

TEST(ViewProtocol, ValuesKeepTheirKind) {
  const auto message = parsed<ClientSetParameters>(
      R"({"op":"setParameters","id":"x","parameters":[{"name":"n","value":3},{"name":"b","value":false},
          {"name":"t","value":"fixed"},{"name":"l","value":[1,2.5]},{"name":"u"},
          {"name":"r","value":[[1.0,2.0],[3.5,4.0]]},{"name":"s","value":["a","b"]}]})");
  EXPECT_EQ(message.request, "x");
  EXPECT_THAT(message.parameters,
              ElementsAre(Parameter{"n", 3.0}, Parameter{"b", false}, Parameter{"t", "fixed"},
                          Parameter{"l", std::vector{1.0, 2.5}}, Parameter{"u", std::nullopt},
                          Parameter{"r", "[[1.0,2.0],[3.5,4.0]]"},
                          Parameter{"s", std::vector<std::string>{"a", "b"}}));
}

TEST(ViewProtocol, WhatAClientPublishesFollowsItsChannel) {
  const std::vector<std::uint8_t> bytes{1, 0x04, 0x03, 0x02, 0x01, '{', '}'};
  const auto message = std::get<ClientData>(parse_client_binary(bytes));
  EXPECT_EQ(message.channel, 0x01020304);
  EXPECT_EQ(message.payload, "{}");
}

TEST(ViewProtocol, NonsenseIsReportedWithTheReason) {
  EXPECT_THAT(why_nonsense("{"), HasSubstr("one JSON object"));
  EXPECT_THAT(why_nonsense("[]"), HasSubstr("one JSON object"));
  EXPECT_THAT(why_nonsense(R"({"op":"dance"})"), HasSubstr("\"dance\" is not known"));
  EXPECT_THAT(why_nonsense(R"({"op":7})"), HasSubstr("\"op\" has to be a string"));
  EXPECT_THAT(why_nonsense(R"({"op":"subscribe"})"), HasSubstr("\"subscriptions\" is missing"));
  EXPECT_THAT(why_nonsense(R"({"op":"subscribe","subscriptions":[1]})"), HasSubstr("of objects"));
  EXPECT_THAT(why_nonsense(R"({"op":"unsubscribe","subscriptionIds":[-1]})"),
              HasSubstr("a whole number from 0"));
  EXPECT_THAT(why_nonsense(R"({"op":"setParameters","parameters":[{"name":"a","value":{}}]})"),
              HasSubstr("\"value\" has to be"));
  EXPECT_THAT(why_nonsense(R"({"op":"setParameters","parameters":[{"name":"a","value":1e999}]})"),
              HasSubstr("one JSON object"));
  for (const auto& bytes : {std::vector<std::uint8_t>{}, {1, 0, 0, 0}, {2, 0, 0, 0, 0}}) {
    EXPECT_TRUE(std::holds_alternative<ClientNonsense>(parse_client_binary(bytes)));
  }
}

TEST(ViewProtocol, ATextThatIsNestedAsDeepAsItMayBeLongIsRefused) {
  EXPECT_NE(why_nonsense(std::string(64 * 1024, '[')), "");
  EXPECT_NE(why_nonsense(std::string(32 * 1024, '[') + std::string(32 * 1024, ']')), "");
}

}  // namespace
}  // namespace tether
