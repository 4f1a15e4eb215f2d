#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <future>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/share.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/version.hpp"
#include "tests/tools/experiment/store.hpp"
#include "tools/experiment/sweep/run_once.hpp"
#include "tools/experiment/sweep/sweeps_below.hpp"
#include "tools/view/sources/log_view.hpp"
#include "tools/view/sources/report_site.hpp"

namespace tether {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using State = MadePage::State;

/// Asks until it is no more waiting or in work.
MadePage end_of(MadePages& pages, const std::string& name) {
  for (;;) {
    const MadePage page = pages.ask(name);
    if (page.state == State::ready || page.state == State::failed) return page;
    std::this_thread::yield();
  }
}

TEST(MadePages, AreMadeOnceAndKept) {
  int made = 0;
  MadePages pages([&made](const std::string& name, const MadePages::Progress& progress) {
    progress(0.5);
    ++made;
    return "page of " + name;
  });
  EXPECT_EQ(pages.find("a"), nullptr);
  EXPECT_EQ(*end_of(pages, "a").page, "page of a");
  EXPECT_EQ(*end_of(pages, "a").page, "page of a");
  EXPECT_EQ(*pages.find("a"), "page of a");
  EXPECT_EQ(made, 1);
}

TEST(MadePages, SayWhyOneCannotBeMadeAndGoOn) {
  MadePages pages([](const std::string& name, const MadePages::Progress&) -> std::string {
    if (name == "bad") throw std::runtime_error("no file");
    return name;
  });
  EXPECT_EQ(end_of(pages, "bad").error, "no file");
  EXPECT_EQ(pages.find("bad"), nullptr);
  EXPECT_EQ(*end_of(pages, "good").page, "good");
}

TEST(MadePages, OnlyTheNewestAreKept) {
  MadePages pages([](const std::string& name, const MadePages::Progress&) { return name; });
  for (std::size_t i = 0; i <= MadePages::kMostKept; ++i) end_of(pages, std::to_string(i));
  EXPECT_EQ(pages.find("0"), nullptr);
  EXPECT_NE(pages.find("1"), nullptr);
}

TEST(MadePages, WaitInARowOfWhichTheEndIsRefusedAndAreGivenUpInTheEnd) {
  std::promise<void> began;
  std::vector<std::string> in_work;
  {
    MadePages pages([&](const std::string& name, const MadePages::Progress& progress) {
      in_work.push_back(name);
      progress(0.25);
      began.set_value();
      for (;;) progress(0.25);
      return std::string();
    });
    pages.ask("first");
    began.get_future().wait();
    EXPECT_EQ(pages.ask("first").state, State::in_work);
    EXPECT_EQ(pages.ask("first").share, 0.25);
    for (std::size_t i = 0; i < MadePages::kMostWaiting; ++i) {
      EXPECT_EQ(pages.ask(std::to_string(i)).state, State::waiting);
    }
    EXPECT_THAT(pages.ask("too many").error, HasSubstr("try again"));
    EXPECT_EQ(pages.ask("0").state, State::waiting);
  }
  EXPECT_THAT(in_work, ElementsAre("first"));
}

/// A sweep of two arms of one second, with seeds 1 and 2, in a folder of its own.
class SweepRunsTest : public ::testing::Test {
 protected:
  SweepRunsTest() {
    experiment_.name = "short";
    experiment_.keys = {"channel.prr"};
    for (const double prr : {1.0, 0.5}) {
      Scenario scenario;
      scenario.get<RunSettings>().duration_s = 2.0;
      scenario.get<VehicleSettings>().plant = VehicleSettings::Plant::kinematic;
      scenario.get<ChannelSettings>().uplink.fixed.prr = prr;
      experiment_.arms.push_back({{{"channel.prr", std::to_string(prr)}}, scenario});
    }
    experiment_.seeds = {1, 2};
  }

  StoredRun run(std::size_t arm, std::uint64_t seed) const {
    Scenario scenario = experiment_.arms[arm].scenario;
    scenario.get<RunSettings>().seed = seed;
    return {arm, seed, run_once(scenario, 0.0)};
  }
  void store(const std::filesystem::path& folder, const std::vector<StoredRun>& runs) const {
    std::filesystem::create_directories(folder);
    RunStore::begin(database_in(folder, {}), experiment_, {}).add(runs);
  }
  static void ignore(double) {}

  test::Folder own_, into_;
  Experiment experiment_;
};

TEST_F(SweepRunsTest, HasTheRunsOfTheFoldersOwnDatabase) {
  store(own_.path, {run(1, 2)});
  const SweepRuns runs(own_.path);
  EXPECT_TRUE(runs.has("/runs/1/2"));
  for (const char* other :
       {"/runs/1/1", "/runs/0/2", "/runs/2/2", "runs/1/2", "/runs/1", "/runs/1/2/", "/runs//1/2",
        "/runs/1/-2", "/runs/01x/2", "", "/", "2", "/1/2"}) {
    EXPECT_FALSE(runs.has(other)) << other;
  }
}

TEST_F(SweepRunsTest, HasThoseOfSubfoldersByTheirNames) {
  store(own_.path / "a b", {run(0, 1)});
  store(own_.path / "ä", {run(0, 2)});
  const SweepRuns runs(own_.path);
  EXPECT_TRUE(runs.has("/runs/a%20b/0/1"));
  EXPECT_TRUE(runs.has("/runs/%C3%A4/0/2"));
  EXPECT_FALSE(runs.has("/runs/a%20b/0/2"));
  EXPECT_FALSE(runs.has("/runs/0/1"));
}

TEST_F(SweepRunsTest, MakesARunAgainWithItsSeedAsALogWithTheScenarioBesideIt) {
  store(own_.path, {run(1, 1), run(1, 2)});
  std::vector<double> told;
  ViewedLog log(SweepRuns(own_.path)
                    .make_again("/runs/1/2", into_.path, [&told](double x) { told.push_back(x); })
                    .string());
  EXPECT_EQ(log.file(), into_.path / "short-arm1-seed2.lcmlog");
  EXPECT_THAT(told, ElementsAre(0.0, 0.5));
  ASSERT_TRUE(log.scenario());
  EXPECT_EQ(log.scenario()->get<RunSettings>().seed, 2U);
  EXPECT_EQ(log.scenario()->get<ChannelSettings>().uplink.fixed.prr, 0.5);
  EXPECT_EQ(log.end_s(), 2.0);
}

TEST_F(SweepRunsTest, RefusesARunThatComesOutOtherwiseWithBothVersions) {
  StoredRun other = run(0, 1);
  other.result.metrics.at(metric_number("epsilon_m").value()) += 1e-6;
  store(own_.path, {other});
  const SweepRuns runs(own_.path);
  try {
    runs.make_again("/runs/0/1", into_.path, ignore);
    FAIL() << "it is taken for the same run";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("arm 0, seed 1"), HasSubstr("cannot be made again"),
                                    HasSubstr("ε comes to"), HasSubstr(kVersion)));
  }
}

TEST_F(SweepRunsTest, RefusesARunOfWhichAFileIsMissing) {
  const auto csv = own_.file("way.csv", "x_m,y_m\n0,0\n5,0\n10,1\n");
  experiment_.arms[0].scenario = parse_scenario(
      "[path]\nkind = \"csv\"\ncsv = \"" + csv.string() + "\"\n[run]\nduration_s = 1.0\n", "test");
  store(own_.path, {run(0, 1)});
  std::filesystem::remove(csv);
  const SweepRuns runs(own_.path);
  EXPECT_THAT([&] { runs.make_again("/runs/0/1", into_.path, ignore); },
              ::testing::ThrowsMessage<std::runtime_error>(HasSubstr("way.csv")));
}

TEST_F(SweepRunsTest, AReportIsServedWithTheFilesBesideItAndNothingElse) {
  store(own_.path / "sweep", {run(0, 1)});
  own_.file("report.html", "<html><body>all</body></html>");
  own_.file("f2.csv", "x,mean\n1,2\n");
  own_.file("sweep/inner.csv", "x\n");
  own_.file("notes.txt", "private");
  ReportSite site(own_.path, shared_file("view"));
  const auto get = [&site](const char* path) { return site.answer(false, path); };
  EXPECT_THAT(get("/").body, HasSubstr("<html data-served><body>all"));
  EXPECT_EQ(get("/f2.csv").body, "x,mean\n1,2\n");
  EXPECT_THAT(get("/f2.csv").type, HasSubstr("text/csv"));
  for (const char* other : {"/notes.txt", "/sweep/inner.csv", "/sweep/runs.sqlite", "/f3.csv",
                            "/../f2.csv", "/..", "/.csv", "/f2.csv/", "/%66%32.csv"}) {
    EXPECT_EQ(get(other).status, 404) << other;
  }
  EXPECT_EQ(site.answer(true, "/f2.csv").status, 404) << "a file takes no POST";
  EXPECT_EQ(site.answer(true, "/").status, 405);
}

TEST_F(SweepRunsTest, AFolderWithoutAReportIsRefusedWithTheCommandThatMakesIt) {
  store(own_.path, {run(0, 1)});
  EXPECT_THAT(
      [&] { ReportSite(own_.path, shared_file("view")); },
      ::testing::ThrowsMessage<UsageError>(HasSubstr("tether report " + own_.path.string())));
}

}  // namespace
}  // namespace tether
