#include "tools/view/sources/network_parameters.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "netem/channel/settings.hpp"
#include "tools/view/sources/network_view.hpp"

namespace tether {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

std::optional<ParameterValue> value(const NetworkParameters& network, const std::string& name) {
  for (const Parameter& parameter : network.values()) {
    if (parameter.name == name) return parameter.value;
  }
  ADD_FAILURE() << "there is no " << name;
  return std::nullopt;
}

std::vector<std::string> in_effect(const NetworkParameters& network) {
  return std::get<std::vector<std::string>>(*value(network, "network.in_effect"));
}

std::string why_refused(const Parameter& parameter) {
  try {
    NetworkParameters().settings({parameter});
    return "";
  } catch (const UsageError& error) {
    return error.what();
  }
}

TEST(ViewNetworkParameters, AreTheDefaultsUntilTheRelaySaysOtherwise) {
  NetworkParameters network;
  EXPECT_EQ(value(network, "network.uplink.prr"), ParameterValue(1.0));
  network.take({{"uplink.prr", "0.25"}, {"downlink.model", "\"markov\""}, {"uplink.loss", "1..."}},
               false);
  EXPECT_EQ(value(network, "network.uplink.prr"), ParameterValue(0.25));
  EXPECT_EQ(value(network, "network.downlink.model"), ParameterValue("markov"));
  EXPECT_EQ(value(network, "network.uplink.loss"), ParameterValue(0.0));  // it was cut off
  network.take({{"downlink.prr", "0.5"}}, true);
  EXPECT_EQ(value(network, "network.uplink.prr"), ParameterValue(1.0));
  EXPECT_EQ(value(network, "network.downlink.prr"), ParameterValue(0.5));
}

TEST(ViewNetworkParameters, SayWhichOfThemDoSomethingNow) {
  NetworkParameters network;
  EXPECT_THAT(in_effect(network), Contains("network.downlink.prr"));
  EXPECT_THAT(in_effect(network), Not(Contains("network.downlink.markov.bad.prr")));
  network.take({{"downlink.model", "\"markov\""}}, false);
  EXPECT_THAT(in_effect(network), Not(Contains("network.downlink.prr")));
  EXPECT_THAT(in_effect(network), Contains("network.downlink.markov.bad.prr"));
}

TEST(ViewNetworkParameters, LinksByNameAppearWhenTheRelayNamesThem) {
  NetworkParameters network;
  network.take({{"links.wifi.prr", "0.75"}}, true);
  EXPECT_EQ(value(network, "network.links.wifi.prr"), ParameterValue(0.75));
}

TEST(ViewNetworkParameters, BecomeSettingsAsTheRelayReadsThem) {
  EXPECT_THAT(
      NetworkParameters().settings({{"network.uplink.prr", 0.45},
                                    {"network.uplink.prr", 1.0},
                                    {"network.uplink.queue_limit", 7.0},
                                    {"network.uplink.model", "markov"},
                                    {"network.uplink.in_order", true},
                                    {"network.uplink.outages", "[[1.0,2.0]]"}}),
      ElementsAre("uplink.prr=0.45", "uplink.prr=1", "uplink.queue_limit=7",
                  "uplink.model=\"markov\"", "uplink.in_order=true", "uplink.outages=[[1.0,2.0]]"));
}

TEST(ViewNetworkParameters, EachSettingOfTheDefaultsIsOneThatTheRelayTakes) {
  const NetworkParameters network;
  for (const Parameter& parameter : network.values()) {
    if (parameter.name == NetworkParameters::kInEffect || !parameter.value) continue;
    const auto effective = in_effect(network);
    if (std::find(effective.begin(), effective.end(), parameter.name) == effective.end()) continue;
    EXPECT_NO_THROW(change_channel({}, network.settings({parameter}))) << parameter.name;
  }
}

TEST(ViewNetworkParameters, WhatIsNoneOrMustNotBeSetIsRefusedByName) {
  EXPECT_THAT(why_refused({"network.uplink.queue_limit", 1.5}), HasSubstr("network.uplink.queue"));
  EXPECT_THAT(why_refused({"network.uplink.trace.file", "/etc/passwd"}), HasSubstr("from here"));
  EXPECT_THAT(why_refused({"network.in_effect", "x"}), HasSubstr("from here"));
  EXPECT_THAT(why_refused({"network.uplink.prr", std::nullopt}), HasSubstr("unset"));
  EXPECT_THAT(why_refused({"network.uplink.model", "a\" = 1\nb"}), HasSubstr("allowed"));
  EXPECT_THAT(why_refused({"network.uplink.outages", "[[1, 2]]\nx = 1"}), HasSubstr("allowed"));
  EXPECT_THAT(why_refused({"network.nothing", 1.0}), HasSubstr("no parameter"));
}

TEST(ViewNetworkParameters, AreDescribedAsAPageHasToShowThem) {
  std::map<std::string, ParameterDescription> by_name;
  const NetworkParameters network;
  for (const auto& d : network.descriptions()) by_name[d.name] = d;
  const auto& prr = by_name.at("network.uplink.prr");
  EXPECT_EQ(prr.kind, "number");
  EXPECT_EQ(prr.low, 0.0);
  EXPECT_EQ(prr.high, 1.0);
  const auto& delay = by_name.at("network.uplink.delay_ms");  // 0 or a number in [1e-06, 1000000]
  EXPECT_EQ(delay.kind, "number");
  EXPECT_EQ(delay.low, 0.0);
  EXPECT_EQ(delay.high, 1e6);
  EXPECT_EQ(by_name.at("network.uplink.queue_limit").kind, "whole number");
  EXPECT_EQ(by_name.at("network.uplink.queue_limit").low, 1.0);
  EXPECT_EQ(by_name.at("network.uplink.in_order").kind, "switch");
  EXPECT_THAT(by_name.at("network.uplink.model").choices, Contains("gilbert_elliott"));
  EXPECT_EQ(by_name.at("network.uplink.outages").kind, "rows");
  EXPECT_FALSE(by_name.at("network.uplink.map.file").can_be_set);
  for (const auto& [name, d] : by_name) {
    const bool is_text = d.kind == "text";
    EXPECT_TRUE(!is_text || !d.can_be_set || d.allowed.find("number") == std::string::npos) << name;
    EXPECT_TRUE(d.kind != "choice" || d.choices.size() > 1) << name;
  }
}

TEST(ViewOperator, RequestsAreNamedAsInTheMessage) {
  EXPECT_EQ(parse_operator_request(R"({"request":"ESTOP"})"), drive_request_t::ESTOP);
  EXPECT_EQ(parse_operator_request(R"({"request":1})"), drive_request_t::ARM);
  for (const char* bad : {"", "{}", "[]", R"({"request":"arm"})", R"({"request":7})", "\xff"}) {
    EXPECT_THROW(parse_operator_request(bad), UsageError) << bad;
  }
}

}  // namespace
}  // namespace tether
