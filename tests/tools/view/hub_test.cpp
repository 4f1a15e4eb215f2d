#include "tools/view/server/hub.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <tether/clock_t.hpp>
#include <tether/pose_t.hpp>
#include <vector>

namespace tether {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using Json = nlohmann::json;

template <class LcmType>
std::vector<std::uint8_t> encoded(const LcmType& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

std::vector<std::uint8_t> pose(std::int64_t seq) {
  pose_t message{};
  message.seq = seq;
  message.x_m = 0.25;
  return encoded(message);
}

/// A hub, one client and what was asked for.
struct ViewHub : ::testing::Test {
  Hub make(Session::Limits limits = {}) {
    Hub::Options options;
    options.publishable = {"CAN/REQUEST"};
    options.most_channels = 3;
    options.limits = limits;
    return Hub(options, [this](ViewRequest request) { asked.push_back(std::move(request)); });
  }

  /// All that waits for the client: texts as they are, data as "subscription@time payload".
  std::vector<std::string> sent(Hub& of, ClientId client) {
    std::vector<std::string> all;
    while (const auto message = of.session(client).next()) {
      const std::string payload = message->payload ? *message->payload : "";
      if (message->is_text) {
        all.push_back(payload);
        continue;
      }
      std::uint32_t subscription = 0;
      std::uint64_t time_ns = 0;
      std::memcpy(&subscription, message->header.data() + 1, 4);
      std::memcpy(&time_ns, message->header.data() + 5, 8);
      all.push_back(std::to_string(subscription) + "@" + std::to_string(time_ns) + " " +
                    std::to_string(Json::parse(payload)["seq"].get<int>()));
    }
    return all;
  }
  std::vector<std::string> sent() { return sent(hub, client); }
  std::string op_of(const std::string& text) { return Json::parse(text)["op"]; }

  std::vector<ViewRequest> asked;
  Hub hub = make();
  ClientId client = hub.connect();
};

const std::string kSubscribe = R"({"op":"subscribe","subscriptions":[{"id":9,"channelId":1}]})";

TEST_F(ViewHub, AClientIsFirstToldWhoThisIsAndWhatThereIs) {
  hub.hear("AGV/POSE", pose(1), 5);
  const ClientId late = hub.connect();
  const auto texts = sent(hub, late);
  ASSERT_THAT(texts, SizeIs(2));
  EXPECT_EQ(op_of(texts[0]), "serverInfo");
  EXPECT_EQ(Json::parse(texts[1])["channels"][0]["topic"], "AGV/POSE");
  EXPECT_EQ(Json::parse(texts[1])["channels"][0]["schemaName"], "tether.pose_t");
}

TEST_F(ViewHub, WhatAClientSubscribedToArrivesAndNothingElse) {
  hub.hear("AGV/POSE", pose(1), 5);
  hub.hear("CTRL/POSE", pose(2), 6);
  sent();
  hub.on_text(client, kSubscribe);
  hub.hear("AGV/POSE", pose(3), 7);
  hub.hear("CTRL/POSE", pose(4), 8);
  EXPECT_THAT(sent(), ElementsAre("9@5 1", "9@7 3"));  // the newest at once, then the next
  hub.on_text(client, R"({"op":"unsubscribe","subscriptionIds":[9]})");
  hub.hear("AGV/POSE", pose(5), 9);
  EXPECT_THAT(sent(), IsEmpty());
}

TEST_F(ViewHub, AChannelWhoseTypeChangesIsAnotherOne) {
  hub.hear("AGV/POSE", pose(1), 5);
  sent();
  hub.on_text(client, kSubscribe);
  sent();
  hub.hear("AGV/POSE", encoded(clock_t{}), 6);
  const auto texts = sent();
  ASSERT_THAT(texts, SizeIs(2));
  EXPECT_EQ(Json::parse(texts[0]), Json::parse(R"({"op":"unadvertise","channelIds":[1]})"));
  EXPECT_EQ(Json::parse(texts[1])["channels"][0]["id"], 2);
  EXPECT_THAT(hub.session(client).channels, IsEmpty());
}

TEST_F(ViewHub, WhatCannotBeDecodedIsCountedAndNotShown) {
  std::vector<std::uint8_t> cut = pose(1);
  cut.pop_back();
  hub.hear("AGV/POSE", cut, 5);
  hub.hear("AGV/POSE", std::vector<std::uint8_t>{1, 2, 3}, 5);
  hub.hear("AGV/POSE", {}, 5);
  EXPECT_THAT(hub.counters(), ::testing::Contains(std::pair("messages.not_decodable", 3)));
  EXPECT_THAT(hub.counters(), ::testing::Contains(std::pair("channels", 0)));
}

TEST_F(ViewHub, ChannelsBeyondTheMostAreCountedAndNotShown) {
  for (int i = 0; i < 5; ++i) hub.hear("A" + std::to_string(i), pose(i), 5);
  EXPECT_THAT(hub.counters(), ::testing::Contains(std::pair("channels", 3)));
  EXPECT_THAT(hub.counters(), ::testing::Contains(std::pair("messages.of_too_many_channels", 2)));
}

TEST_F(ViewHub, OfAClientThatDoesNotReadTheOldestDataAreDroppedAndCounted) {
  hub.hear("AGV/POSE", pose(0), 0);
  hub.on_text(client, kSubscribe);
  sent();
  Session::Limits limits;
  limits.data_bytes = 1000;
  Hub small = make(limits);
  const ClientId slow = small.connect();
  small.hear("AGV/POSE", pose(0), 0);
  small.on_text(slow, kSubscribe);
  for (int i = 1; i <= 100; ++i) {
    small.hear("AGV/POSE", pose(i), static_cast<std::uint64_t>(i));
  }
  small.update({{"a", 1.0}});
  const std::int64_t dropped = small.session(slow).dropped();
  const auto all = sent(small, slow);
  // serverInfo and two advertise are kept; of 101 data as many as fit, the newest.
  EXPECT_EQ(static_cast<std::int64_t>(all.size()), 3 + 101 - dropped);
  EXPECT_GT(dropped, 80);
  EXPECT_EQ(all.back(), "9@100 100");
  EXPECT_FALSE(small.session(slow).is_overwhelmed());
}

TEST_F(ViewHub, WhatComesRarelyReachesAClientThatReadsTooSlowlyForTheRest) {
  Session::Limits limits;
  limits.data_bytes = 1000;
  Hub small = make(limits);
  const ClientId slow = small.connect();
  small.hear("RARE", pose(7), 1);
  small.hear("OFTEN", pose(0), 2);
  small.on_text(slow, R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":1},
      {"id":2,"channelId":2}]})");
  for (int i = 1; i <= 100; ++i) {
    small.hear("OFTEN", pose(i), static_cast<std::uint64_t>(i));
  }
  EXPECT_GT(small.session(slow).dropped(), 80);
  const auto all = sent(small, slow);
  EXPECT_THAT(all, ::testing::Contains("1@1 7"));
  EXPECT_EQ(all.back(), "2@100 100");
}

TEST_F(ViewHub, AClientThatLeavesTooMuchTextUnreadIsOverwhelmed) {
  Session::Limits limits;
  limits.text_bytes = 10'000;
  Hub small = make(limits);
  const ClientId slow = small.connect();
  EXPECT_FALSE(small.session(slow).is_overwhelmed());
  for (int i = 0; i < 1000; ++i) small.on_text(slow, "nonsense");
  EXPECT_TRUE(small.session(slow).is_overwhelmed());
}

TEST_F(ViewHub, ChangesOfParametersAreSentOnceToEachSubscriber) {
  hub.update({{"a", 1.0}, {"b", true}});
  sent();
  hub.on_text(client, R"({"op":"subscribeParameterUpdates","parameterNames":["a"]})");
  hub.update({{"a", 2.0}, {"b", false}});
  hub.update({{"a", 2.0}});  // no change
  const auto texts = sent();
  ASSERT_THAT(texts, SizeIs(1));
  EXPECT_EQ(
      Json::parse(texts[0]),
      Json::parse(
          R"({"op":"parameterValues","parameters":[{"name":"a","value":2,"type":"float64"}]})"));
}

TEST_F(ViewHub, WhoSubscribedToAllParametersHearsOfNewOnesToo) {
  sent();
  hub.on_text(client, R"({"op":"subscribeParameterUpdates","parameterNames":[]})");
  hub.update({{"late", 1.0}});
  EXPECT_THAT(sent(), ElementsAre(HasSubstr("late")));
  hub.on_text(client, R"({"op":"unsubscribeParameterUpdates","parameterNames":[]})");
  hub.update({{"late", 2.0}});
  EXPECT_THAT(sent(), IsEmpty());
}

TEST_F(ViewHub, SettingIsForTheProgramAndItsAnswerForTheClient) {
  hub.update({{"a", 1.0}});
  sent();
  hub.on_text(client, R"({"op":"setParameters","id":"r","parameters":[{"name":"a","value":5}]})");
  ASSERT_THAT(asked, SizeIs(1));
  EXPECT_EQ(std::get<std::vector<Parameter>>(asked[0].what).at(0), (Parameter{"a", 5.0}));
  EXPECT_THAT(sent(), IsEmpty());  // nothing is known yet
  hub.answer({client, "r", {"a"}, "too much"});
  const auto texts = sent();
  ASSERT_THAT(texts, SizeIs(2));
  EXPECT_THAT(texts[0], HasSubstr("too much"));
  EXPECT_THAT(texts[1], HasSubstr(R"("value":1.0)"));  // value as given
  EXPECT_THAT(texts[1], HasSubstr(R"("id":"r")"));
}

TEST_F(ViewHub, UnknownParametersAndTopicsAreRefused) {
  sent();
  hub.on_text(client, R"({"op":"setParameters","parameters":[{"name":"zz","value":5}]})");
  hub.on_text(
      client,
      R"({"op":"advertise","channels":[{"id":1,"topic":"CTRL/CMD_VEL","encoding":"json"}]})");
  hub.on_binary(client, std::vector<std::uint8_t>{1, 1, 0, 0, 0, '{', '}'});
  EXPECT_THAT(asked, IsEmpty());
  EXPECT_THAT(sent(),
              ElementsAre(HasSubstr("no parameter zz"), HasSubstr("clients may not publish"),
                          HasSubstr("channel 1 was not advertised")));
}

TEST_F(ViewHub, WhatAClientMayPublishIsPassedOn) {
  hub.on_text(
      client,
      R"({"op":"advertise","channels":[{"id":1,"topic":"CAN/REQUEST","encoding":"json"}]})");
  hub.on_binary(client, std::vector<std::uint8_t>{1, 1, 0, 0, 0, '{', '}'});
  ASSERT_THAT(asked, SizeIs(1));
  EXPECT_EQ(std::get<ViewRequest::Publish>(asked[0].what).topic, "CAN/REQUEST");
  EXPECT_EQ(std::get<ViewRequest::Publish>(asked[0].what).json, "{}");
}

TEST_F(ViewHub, OneChannelIsSubscribedToOnce) {
  hub.hear("AGV/POSE", pose(1), 5);
  sent();
  hub.on_text(client, kSubscribe);
  hub.on_text(client, R"({"op":"subscribe","subscriptions":[{"id":10,"channelId":1}]})");
  hub.on_text(client, R"({"op":"subscribe","subscriptions":[{"id":9,"channelId":77}]})");
  EXPECT_THAT(sent(), ElementsAre("9@5 1", HasSubstr("subscribed to already"),
                                  HasSubstr("there is no channel 77")));
}

TEST_F(ViewHub, AClientThatIsGoneLeavesNothing) {
  hub.hear("AGV/POSE", pose(1), 5);
  hub.on_text(client, kSubscribe);
  hub.disconnect(client);
  hub.hear("AGV/POSE", pose(2), 6);
  hub.answer({client, "r", {"a"}, "late"});
  EXPECT_EQ(hub.clients(), 0);
}

/// Makes one channel of all poses.
class Doubler final : public DerivedChannels {
 public:
  const std::vector<Description>& channels() const override { return channels_; }
  bool reads(std::string_view, const MessageType& type) const override {
    return type.name == "pose_t";
  }
  void on_message(std::string_view, const MessageContent& message, std::uint64_t,
                  const Emit& emit) override {
    ++calls;
    emit(0, "{\"seq\":" + std::to_string(2 * message.integer("seq").value_or(0)) + "}");
  }
  int calls = 0;

 private:
  std::vector<Description> channels_{{"VIEW/DOUBLE", "double", "{}"}};
};

TEST_F(ViewHub, DerivedChannelsAreMadeForANewListenerFromTheNewestOfEachChannel) {
  auto owned = std::make_unique<Doubler>();
  Doubler& doubler = *owned;
  Hub::Options options;
  Hub derived(
      options, [](const ViewRequest&) {}, std::move(owned));
  const ClientId listener = derived.connect();
  derived.hear("A/POSE", pose(1), 5);
  derived.hear("B/POSE", pose(2), 6);
  EXPECT_EQ(doubler.calls, 0);
  sent(derived, listener);
  derived.on_text(listener, kSubscribe);  // the derived one is the first channel
  derived.hear("A/POSE", pose(3), 7);
  EXPECT_THAT(sent(derived, listener), ElementsAre("9@5 2", "9@6 4", "9@7 6"));
}

}  // namespace
}  // namespace tether
