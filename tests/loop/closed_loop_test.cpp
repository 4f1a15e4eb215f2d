#include "tools/nodes/closed_loop.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <thread>

#include "common/base/errors.hpp"
#include "netem/relay/netem_node.hpp"
#include "sim/node/sim_node.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/tools/runs/run_files.hpp"

namespace fs = std::filesystem;

namespace tether {
namespace {

using test::contents;
using test::Files;
using test::Folder;
using test::run_and_hash;
using test::run_into;

Scenario paper(const std::vector<std::string>& overrides = {}) {
  return load_scenario(in_source("/scenarios/paper.toml"), overrides);
}

/// Noise, loss, delay and both Markov channels at once.
Scenario everything_random(std::uint64_t seed) {
  return paper({"run.seed=" + std::to_string(seed), "run.duration_s=30", "sensor.rate_hz=20",
                "sensor.position_noise_m=0.02", "sensor.yaw_noise_rad=0.01", "sensor.latency_ms=5",
                "channel.model=markov", "channel.markov.mean_good_s=2",
                "channel.markov.mean_bad_s=1"});
}

TEST(ClosedLoop, SameScenarioAndSeedGiveByteIdenticalFiles) {
  const Files first = run_and_hash(everything_random(7));
  EXPECT_GT(first.log_size, 100'000U);
  EXPECT_EQ(run_and_hash(everything_random(7)), first);
}

TEST(ClosedLoop, AnotherSeedGivesAnotherLog) {
  EXPECT_FALSE(run_and_hash(everything_random(7)) == run_and_hash(everything_random(8)));
}

TEST(ClosedLoop, FourRunsAtOnceOnFourThreadsAreByteIdenticalToOneAlone) {
  const Files alone = run_and_hash(everything_random(7));
  Files together[4];
  std::vector<std::thread> threads;
  for (Files& files : together) {
    threads.emplace_back([&files] { files = run_and_hash(everything_random(7)); });
  }
  for (std::thread& t : threads) t.join();
  for (const Files& files : together) EXPECT_EQ(files, alone);
}

TEST(ClosedLoop, TheResolvedScenarioReproducesTheRun) {
  const Folder folder;
  const Scenario scenario = everything_random(9);
  run_into(folder.path / "a", scenario);
  run_into(folder.path / "b", load_scenario((folder.path / "a" / "scenario.toml").string(), {}));
  EXPECT_EQ(contents(folder.path / "a" / "run.lcmlog"), contents(folder.path / "b" / "run.lcmlog"));
}

TEST(ClosedLoop, SplittingTheRunForProgressChangesNothing) {
  const Scenario scenario = everything_random(3);
  ClosedLoop whole(scenario), split(scenario);
  whole.run();
  for (double t = 0.0; t < 30.0; t += 0.37) split.run_until(kStart + from_seconds(t));
  split.run();
  EXPECT_EQ(whole.sim().metrics().epsilon_m(), split.sim().metrics().epsilon_m());
}

TEST(ClosedLoop, LosingEverythingLeavesTheVehicleWhereItWas) {
  ClosedLoop loop(paper({"channel.prr=0"}));
  loop.run();
  EXPECT_NEAR(loop.sim().metrics().epsilon_m(), 14.79, 0.01);
  EXPECT_EQ(loop.netem().uplink().counters().delivered, 0);
}

TEST(ClosedLoop, EveryPacketIsAccountedFor) {
  ClosedLoop loop(paper({"channel.prr=0.6", "channel.delay_ms=700", "sensor.rate_hz=20"}));
  loop.run();
  for (const Link* link : {&loop.netem().uplink(), &loop.netem().downlink()}) {
    const Link::Counters& c = link->counters();
    EXPECT_GT(c.lost, 0);
    EXPECT_EQ(c.offered, c.lost + c.overflowed + c.delivered + link->in_flight());
  }
}

TEST(RunObserver, AgeOfInformationOfAPeriodicPoseIsHalfThePeriodPlusTheDelay) {
  const Scenario scenario =
      paper({"sensor.rate_hz=1", "channel.delay_ms=200", "run.duration_s=60"});
  ClosedLoop loop(scenario);
  RunObserver observer(scenario, loop.loop(), loop.bus());
  loop.run();
  // Sawtooth from 0.2 to 1.2 s: mean 0.7 s. Before the first arrival it rises from 0 to 0.2 s
  // where the sawtooth would be 1.0 … 1.2 s: 0.2 s of 60 s with 1 s less, so 3.3 ms less.
  EXPECT_NEAR(observer.aoi_mean_s(loop.loop().now()), 0.7 - 0.2 / 60.0, 1e-9);
}

TEST(OutputFolder, RefusesAFolderWithForeignFilesAndLeavesThemAlone) {
  const Folder folder;
  std::ofstream(folder.path / "thesis.tex") << "precious";
  EXPECT_THROW(OutputFolder(folder.path, Scenario{}), UsageError);
  EXPECT_EQ(contents(folder.path / "thesis.tex"), "precious");
  EXPECT_FALSE(fs::exists(folder.path / "scenario.toml"));
}

TEST(OutputFolder, RefusesAFolderWithAUsersOwnScenario) {
  const Folder folder;
  std::ofstream(folder.path / "scenario.toml") << "[run]\nseed = 5  # mine\n";
  EXPECT_THROW(OutputFolder(folder.path, Scenario{}), UsageError);
  EXPECT_EQ(contents(folder.path / "scenario.toml"), "[run]\nseed = 5  # mine\n");
}

TEST(OutputFolder, RefusesAnEarlierRunsFolderToWhichAFileWasAdded) {
  const Folder folder;
  run_into(folder.path, paper({"run.duration_s=1"}));
  std::ofstream(folder.path / "notes.txt") << "precious";
  EXPECT_THROW(OutputFolder(folder.path, Scenario{}), UsageError);
}

TEST(OutputFolder, ReplacesAnEarlierRunsResults) {
  const Folder folder;
  run_into(folder.path, paper({"run.duration_s=2"}));
  run_into(folder.path, paper({"run.duration_s=1"}));
  EXPECT_NE(contents(folder.path / "scenario.toml").find("duration_s = 1"), std::string::npos);
}

}  // namespace
}  // namespace tether
