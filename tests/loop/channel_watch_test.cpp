#include "netem/fit/channel_watch.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/scenario/run_settings.hpp"
#include "netem/relay/netem_node.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/runs/channel_report.hpp"
#include "tools/runs/run_observer.hpp"
#include "tools/runs/run_summary.hpp"

// Reports of a run on its links, in the whole loop, in virtual time.

namespace tether {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

Scenario watched(const std::vector<std::string>& keys, const std::string& file = "paper.toml") {
  return load_scenario(in_source("/scenarios/") + file, keys);
}

struct Watched {
  explicit Watched(const Scenario& scenario)
      : loop(scenario),
        observer(scenario, loop.loop(), loop.bus()),
        watch(scenario.get<ChannelSettings>(), channel_traffic(scenario, true), loop.loop(),
              loop.netem().uplink(), loop.netem().downlink()) {
    loop.run();
    summary.channel = watch.report(kStart + from_seconds(scenario.get<RunSettings>().duration_s));
    json = nlohmann::json::parse(to_json(scenario, observer, summary));
    text = to_text(scenario, observer, summary);
  }

  ClosedLoop loop;
  RunObserver observer;
  ChannelWatch watch;
  RunSummary summary;
  nlohmann::json json;
  std::string text;
};

/// All that was published, in order.
using Traffic = std::vector<std::pair<std::string, std::vector<std::uint8_t>>>;

Traffic traffic_of(const Scenario& scenario, bool watched) {
  ClosedLoop loop(scenario);
  Traffic traffic;
  loop.bus().subscribe(".*", kDeepQueue, [&](const Message& m) {
    traffic.emplace_back(m.channel, std::vector<std::uint8_t>(m.bytes.begin(), m.bytes.end()));
  });
  std::optional<ChannelWatch> watch;
  if (watched) {
    watch.emplace(scenario.get<ChannelSettings>(), channel_traffic(scenario, true), loop.loop(),
                  loop.netem().uplink(), loop.netem().downlink());
  }
  loop.run();
  return traffic;
}

TEST(ChannelWatch, ChangesNoByteOfARun) {
  for (const char* file : {"paper.toml", "paper_markov.toml"}) {
    const Scenario scenario = watched({"channel.jitter.law=gamma", "channel.jitter.mean_ms=30",
                                       "channel.jitter.sd_ms=20", "run.duration_s=30"},
                                      file);
    const Traffic alone = traffic_of(scenario, false);
    EXPECT_GT(alone.size(), 1000U);
    EXPECT_EQ(alone, traffic_of(scenario, true));
  }
}

TEST(ChannelWatch, APerfectNetworkIsAsConfiguredInAPaperRun) {
  const Watched run(watched({}));
  EXPECT_EQ(run.json["uplink"]["channel_check"], "ok");
  EXPECT_EQ(run.json["downlink"]["channel_check"], "ok");
  EXPECT_EQ(run.json["uplink"]["check"].size(), 4U);
  const nlohmann::json& prr = run.json["uplink"]["check"][0];
  EXPECT_EQ(prr["quantity"], "PRR");
  EXPECT_EQ(prr["configured"], 1.0);
  EXPECT_EQ(prr["achieved"], 1.0);
  EXPECT_EQ(prr["high"], 1.0);
  EXPECT_EQ(prr["verdict"], "ok");
  EXPECT_THAT(run.text, HasSubstr("channel as configured: PRR, delay p50, p90, p99\n"));
  EXPECT_THAT(run.text, Not(HasSubstr("NOT AS CONFIGURED")));
}

TEST(ChannelWatch, APaperRunAtHalfReceptionIsTooShort) {
  const Watched run(watched({"channel.prr=0.5"}));
  EXPECT_EQ(run.json["uplink"]["channel_check"], "too short");
  EXPECT_THAT(run.text, HasSubstr("too short to say: PRR, mean loss burst, lag-1 correlation; "
                                  "channel as configured: delay p50, p90, p99\n"));
}

TEST(ChannelWatch, ALongRunsStatesAreTheProcesss) {
  const Watched run(watched({"sensor.rate_hz=20", "run.duration_s=300", "channel.model=markov",
                             "channel.markov.mean_good_s=0.3", "channel.markov.mean_bad_s=0.1",
                             "channel.markov.bad.delay_ms=0", "world.half_extent_m=1000"}));
  for (const char* link : {"uplink", "downlink"}) {
    std::map<std::string, nlohmann::json> rows;
    for (const auto& row : run.json[link]["check"]) rows[row["quantity"]] = row;
    // Commands answer the poses that arrive: not periodically, as the uplink loses some.
    const bool irregular = link == std::string("downlink");
    EXPECT_EQ(rows["PRR"]["verdict"], "ok") << rows["PRR"];
    EXPECT_EQ(rows["mean sojourn (good)"]["verdict"], "ok") << rows["mean sojourn (good)"];
    EXPECT_EQ(rows["mean sojourn (bad)"]["verdict"], "ok") << rows["mean sojourn (bad)"];
    EXPECT_EQ(rows["mean sojourn (bad)"]["unit"], "s");
    EXPECT_EQ(rows["mean loss burst"]["verdict"], irregular ? "not comparable" : "ok");
    EXPECT_EQ(rows["mean loss burst"]["configured"].is_null(), irregular);
  }
}

TEST(ChannelWatch, CommandsThroughASharedStateAreNotComparable) {
  const Watched run(watched({}, "paper_markov.toml"));
  EXPECT_EQ(run.json["downlink"]["check"][0]["verdict"], "not comparable");
  EXPECT_THAT(run.json["downlink"]["check"][0]["reason"], HasSubstr("commands answer the poses"));
  EXPECT_NE(run.json["uplink"]["check"][0]["verdict"], "not comparable");
}

TEST(ChannelWatch, TheLeadDoesNotCount) {
  const Watched run(watched({"run.lead_s=5", "sensor.rate_hz=10", "run.duration_s=3"}));
  EXPECT_EQ(run.summary.channel->uplink.packets, 31);
  EXPECT_GT(run.loop.netem().uplink().counters().offered, 31);
}

TEST(ChannelReport, WhatIsOutsideHasARowInTheSummary) {
  ChannelReport::Direction link{100, {}};
  link.checks.push_back({"PRR", "", 0.8, {0.9, 0.89, 0.91, 1000.0}, Verdict::outside, ""});
  link.checks.push_back({"delay p50", "ms", 5.0, {5.0, 5.0, 5.0, 90.0}, Verdict::ok, ""});
  EXPECT_EQ(
      to_text(link),
      "          channel as configured: delay p50\n"
      "          NOT AS CONFIGURED\n"
      "          quantity                        configured    achieved  95 % interval           "
      "verdict\n"
      "          PRR                                    0.8         0.9  0.89 … 0.91             "
      "outside\n");
  EXPECT_EQ(to_json(link)["channel_check"], "outside");
}

TEST(ChannelReport, WhatIsUnknownIsNull) {
  ChannelReport::Direction link{100, {}};
  link.checks.push_back({"delay p99",
                         "ms",
                         NAN,
                         {3.0, 1.0, INFINITY, 2.0},
                         Verdict::not_comparable,
                         "the recording decides"});
  const auto row = to_json(link)["check"][0];
  EXPECT_TRUE(row["configured"].is_null());
  EXPECT_TRUE(row["high"].is_null());
  EXPECT_EQ(row["low"], 1.0);
  EXPECT_EQ(row["reason"], "the recording decides");
  EXPECT_EQ(to_json(link)["channel_check"], "not comparable");
  EXPECT_EQ(to_text(link), "          not comparable, because the recording decides: delay p99\n");
}

}  // namespace
}  // namespace tether
