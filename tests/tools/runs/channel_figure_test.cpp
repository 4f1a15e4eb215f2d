#include "tools/runs/channel_figure.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "netem/channel/settings.hpp"
#include "netem/fit/channel_watch.hpp"
#include "netem/relay/make_links.hpp"
#include "tests/support/folder.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

class ChannelFigureTest : public ::testing::Test {
 protected:
  ChannelFigureTest() {
    scenario_ =
        parse_scenario("", "test.toml",
                       {"channel.downlink.jitter.law=gamma", "channel.downlink.jitter.mean_ms=20",
                        "channel.downlink.jitter.sd_ms=5"});
  }

  ChannelFigure figure(std::int64_t packets) {
    const LinkTraffic traffic{0.05, 50.0};
    LinkPair links = make_links(scenario_);
    return {"a link", "a link, gamma delays", traffic.interval_s,
            sample_fates(links.downlink, traffic, packets),
            expect_link(scenario_.get<ChannelSettings>().downlink, traffic)};
  }

  std::vector<std::vector<std::string>> rows(const std::string& name) const {
    std::ifstream in(folder_ / name);
    std::vector<std::vector<std::string>> rows;
    std::string line, cell;
    std::getline(in, line);
    while (std::getline(in, line)) {
      std::istringstream cells(line + ",");
      rows.emplace_back();
      while (std::getline(cells, cell, ',')) rows.back().push_back(cell);
    }
    return rows;
  }

  bool drawn(const std::string& name) const {
    return fs::exists(folder_ / (name + ".svg")) && fs::file_size(folder_ / (name + ".png")) > 1000;
  }

  const test::Folder own_;
  const fs::path folder_ = own_.path;
  Scenario scenario_;
};

TEST_F(ChannelFigureTest, TheStripShowsTheFateOfEachPacket) {
  scenario_.get<ChannelSettings>().downlink.fixed.prr = 0.7;
  const ChannelFigure f = figure(700);
  draw_losses(folder_, f);
  const auto strip = rows("losses.csv");
  ASSERT_EQ(strip.size(), kStripPackets);
  for (std::size_t i = 0; i < strip.size(); ++i) {
    const bool received = f.fates[i].outcome == PacketFate::Outcome::under_way;
    EXPECT_EQ(strip[i][0], std::to_string(i));
    EXPECT_EQ(strip[i][2], received ? "received" : "lost");
  }
  EXPECT_TRUE(drawn("losses"));
}

// Kolmogorov's distance of 50 000 samples from their own law exceeds 1.95/√n = 0.0087 with a
// probability of 0.001.
TEST_F(ChannelFigureTest, AchievedDelaysLieOnTheConfiguredDistribution) {
  draw_delays(folder_, figure(50'000));
  double distance = 0.0;
  for (const auto& row : rows("delays.csv")) {
    ASSERT_EQ(row.size(), 3u);
    distance = std::max(distance, std::abs(std::stod(row[0]) - std::stod(row[2])));
  }
  EXPECT_LT(distance, 0.0087);
  EXPECT_TRUE(drawn("delays"));
}

TEST_F(ChannelFigureTest, WithoutAnyPacketReceivedThereAreNoDelaysToDraw) {
  scenario_.get<ChannelSettings>().downlink.fixed.prr = 0.0;
  const ChannelFigure f = figure(100);
  draw_losses(folder_, f);
  draw_delays(folder_, f);
  EXPECT_TRUE(drawn("losses"));
  EXPECT_FALSE(fs::exists(folder_ / "delays.csv"));
}

}  // namespace
}  // namespace tether
