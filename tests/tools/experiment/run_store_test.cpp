#include "tools/experiment/sweep/run_store.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <bit>
#include <filesystem>
#include <fstream>

#include "common/base/errors.hpp"
#include "common/base/fnv1a.hpp"
#include "common/path/path_settings.hpp"
#include "common/world/surroundings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "netem/channel/settings.hpp"
#include "netem/models/trace_process.hpp"
#include "tests/tools/experiment/store.hpp"
#include "tools/experiment/sweep/export.hpp"

namespace tether {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::SizeIs;
using ::testing::ThrowsMessage;

TEST_F(Store, GivesBackWhatWasPutInByArmAndSeed) {
  begin().add({{1, 2, result(4.0)}, {0, 1, result(1.0)}, {1, 1, failure("it broke")}});
  const RunStore store = RunStore::open(file_);
  const auto runs = runs_of(store);
  ASSERT_THAT(runs, SizeIs(3));
  EXPECT_EQ(runs[0].arm, 0U);
  EXPECT_EQ(runs[0].result, result(1.0));
  EXPECT_EQ(runs[1].arm, 1U);
  EXPECT_EQ(runs[1].seed, 1U);
  EXPECT_EQ(runs[1].result.failure, "it broke");
  EXPECT_TRUE(std::isnan(runs[1].result.metrics[0]));
  EXPECT_EQ(runs[2].result, result(4.0));
  EXPECT_EQ(store.size(), 3U);
  EXPECT_EQ(store.failures(), 1U);
  ASSERT_TRUE(store.first_failure());
  EXPECT_EQ(store.first_failure()->arm, 1U);
  EXPECT_EQ(store.first_failure()->seed, 1U);
  EXPECT_EQ(store.first_failure()->why, "it broke");
  EXPECT_EQ(store.name(), "two_arms");
  EXPECT_EQ(store.plant(), "ode");
}

TEST_F(Store, ExportsRowsThatDoNotDependOnTheOrderOfTheRuns) {
  begin().add({{1, 1, result(4.0)}, {0, 1, failure("a \"bad\", bad run")}});
  const std::string text = exported(RunStore::open(file_));
  EXPECT_THAT(text, HasSubstr("arm,channel.prr,seed,plant,failure,epsilon_m,"));
  EXPECT_THAT(text, HasSubstr("\n0,1,1,ode,\"a \"\"bad\"\", bad run\",,"));
  EXPECT_THAT(text, HasSubstr("\n1,0.5,1,ode,,4,0.5,"));
}

TEST_F(Store, ExportsATimeOfLossOfVehiclesThatWereLostAlone) {
  RunStore store = begin();
  const std::size_t lost = *metric_number("lost"), from = *metric_number("lost_from_s");
  for (const std::uint64_t seed : {1U, 2U}) {
    RunResult r = result(1.0);
    r.metrics[lost] = seed == 2 ? 1.0 : 0.0;
    r.metrics[from] = 61.75;
    store.add({{0, seed, r}});
  }
  const std::string text = exported(store);
  EXPECT_NE(text.find(",1,61.75,"), std::string::npos) << text;
  EXPECT_NE(text.find(",0,,"), std::string::npos) << text;
}

TEST_F(Store, IsOpenedAgainByTheSameExperiment) {
  begin().add({{0, 1, result(1.0)}});
  RunStore again = begin();
  again.add({{0, 2, result(2.0)}});
  EXPECT_EQ(again.size(), 2U);
}

TEST_F(Store, KeepsEitherAllOfAnAdditionOrNothing) {
  RunStore store = begin();
  store.add({{0, 1, result(1.0)}});
  EXPECT_ANY_THROW(store.add({{0, 2, result(2.0)}, {0, 1, result(1.0)}}));
  EXPECT_EQ(store.size(), 1U);
}

TEST_F(Store, RefusesAnotherExperimentAndSaysWhatDiffers) {
  begin();
  const auto refuses = [this](const Experiment& other, const std::string& what) {
    EXPECT_THAT([&] { begin(other); },
                ThrowsMessage<UsageError>(AllOf(HasSubstr(file_.string()), HasSubstr(what))));
  };
  Experiment other = two_arms();
  other.seeds = {1, 2, 3};
  refuses(other, "seeds = 1 to 2; now it is 1 to 3");
  other = two_arms();
  other.arms[1].scenario.get<ControllerSettings>().tau_s = 3.0;
  refuses(other, "\"tau_s = 2.0\"; now it is \"tau_s = 3.0\"");
  other = two_arms();
  other.arms[1].settings[0].value = "0.6";
  refuses(other, "combination 1 = channel.prr = 0.5; now it is channel.prr = 0.6");
  other = two_arms();
  other.arms.pop_back();
  refuses(other, "combinations = 2; now it is 1");
  other = two_arms();
  other.precision = Precision{"epsilon_m", 0.5, 50, 10};
  refuses(other, "precision = none; now it is epsilon_m to ±0.5");
  other = two_arms();
  other.common_random_numbers = false;
  refuses(other, "common_random_numbers = true");
  other = two_arms();
  other.trajectory_period_s = 0.5;
  refuses(other, "trajectory_period_s = 1; now it is 0.5");
}

TEST_F(Store, RefusesAnotherVersionOfTheProgram) {
  begin();
  Database(file_, Database::Mode::write)
      .execute(fmt::format("UPDATE meta SET value = '0.0.9+abc', sum = {} WHERE key = 'version'",
                           std::bit_cast<std::int64_t>(fnv1a("7:version9:0.0.9+abc"))));
  EXPECT_THAT([&] { begin(); },
              ThrowsMessage<UsageError>(HasSubstr("version = 0.0.9+abc; now it is ")));
}

TEST_F(Store, RefusesATraceThatHasChanged) {
  const auto trace = folder_ / "trace.csv";
  Experiment e = two_arms();
  e.arms[0].scenario.get<ChannelSettings>().uplink.model = "trace";
  e.arms[0].scenario.get<ChannelSettings>().uplink.own.get<TraceConfig>().file = trace.string();
  std::ofstream(trace) << "time_s,delay_ms,prr\n0,0,1\n";
  begin(e);
  std::ofstream(trace) << "time_s,delay_ms,prr\n0,0,0.5\n";
  EXPECT_THAT([&] { begin(e); }, ThrowsMessage<UsageError>(HasSubstr("trace.csv")));
}

TEST_F(Store, RefusesWaypointsThatHaveChanged) {
  const auto lap = folder_ / "lap.csv";
  Experiment e = two_arms();
  e.arms[0].scenario.get<PathSettings>().kind = "csv";
  e.arms[0].scenario.get<PathSettings>().csv = lap.string();
  std::ofstream(lap) << "x_m,y_m\n0,0\n5,0\n";
  begin(e);
  std::ofstream(lap) << "x_m,y_m\n0,0\n6,0\n";
  EXPECT_THAT([&] { begin(e); }, ThrowsMessage<UsageError>(HasSubstr("lap.csv")));
}

TEST_F(Store, RefusesTheImageOfAMapThatHasChanged) {
  const auto map = folder_ / "hall.yaml", image = folder_ / "hall.pgm";
  std::ofstream(map) << "image: hall.pgm\nresolution: 0.5\norigin: [0, 0, 0]\nnegate: 0\n"
                        "occupied_thresh: 0.65\nfree_thresh: 0.25\n";
  Experiment e = two_arms();
  e.arms[0].scenario.get<Surroundings>().map_file = map.string();
  std::ofstream(image) << "P2 2 1 255\n255 0\n";
  begin(e);
  std::ofstream(image) << "P2 2 1 255\n0 255\n";
  EXPECT_THAT([&] { begin(e); }, ThrowsMessage<UsageError>(HasSubstr("hall.pgm")));
}

TEST_F(Store, RefusesATraceOfALaterChangeThatHasChanged) {
  const auto trace = folder_ / "later.csv";
  Experiment e = two_arms();
  e.arms[0].scenario.get<ChannelSettings>().changes = {
      {5.0, {"uplink.model=trace", "uplink.trace.file=" + trace.string()}}};
  std::ofstream(trace) << "time_s,delay_ms,prr\n0,0,1\n";
  begin(e);
  std::ofstream(trace) << "time_s,delay_ms,prr\n0,0,0.5\n";
  EXPECT_THAT([&] { begin(e); }, ThrowsMessage<UsageError>(HasSubstr("later.csv")));
}

TEST_F(Store, RefusesATraceThatCannotBeRead) {
  Experiment e = two_arms();
  e.arms[0].scenario.get<ChannelSettings>().uplink.model = "trace";
  e.arms[0].scenario.get<ChannelSettings>().uplink.own.get<TraceConfig>().file = "/no/such.csv";
  EXPECT_THAT([&] { begin(e); }, ThrowsMessage<UsageError>(HasSubstr("\"/no/such.csv\"")));
}

TEST_F(Store, AnotherFigureIsNoOtherExperiment) {
  begin();
  Experiment restyled = two_arms();
  restyled.figure.emplace();
  restyled.figure->x = "channel.prr";
  restyled.figure->metric = "epsilon_m";
  restyled.figure->title = "ε";
  const RunStore store = begin(restyled);
  ASSERT_TRUE(store.figure());
  EXPECT_EQ(store.figure()->title, "ε");
}

TEST_F(Store, RefusesWhatIsNoDatabase) {
  std::ofstream(file_) << "This is a text that its owner wants to keep.";
  EXPECT_THAT([&] { begin(); }, ThrowsMessage<UsageError>(HasSubstr("not a database")));
  EXPECT_THAT([&] { RunStore::open(file_); },
              ThrowsMessage<UsageError>(HasSubstr("not a database")));
  std::ifstream in(file_);
  std::string word;
  in >> word;
  EXPECT_EQ(word, "This");
}

TEST_F(Store, RefusesAnotherProgramsDatabase) {
  Database(file_, Database::Mode::create).execute("CREATE TABLE songs(title TEXT)");
  EXPECT_THAT([&] { begin(); }, ThrowsMessage<UsageError>(HasSubstr("no sweep's database")));
}

TEST_F(Store, RefusesADamagedDatabase) {
  {
    RunStore store = begin();
    std::vector<StoredRun> runs;
    for (std::uint64_t seed = 1; seed <= 1000; ++seed) runs.push_back({0, seed, result(1.0)});
    store.add(runs);
  }
  std::filesystem::resize_file(file_, std::filesystem::file_size(file_) / 2);
  EXPECT_THROW(begin(), UsageError);
  EXPECT_THROW(RunStore::open(file_), UsageError);
}

TEST_F(Store, RefusesADatabaseThatContradictsItself) {
  for (const char* damage :
       {"DELETE FROM arms", "UPDATE meta SET value = 'abc' WHERE key = 'wall_time_s'",
        "UPDATE meta SET value = 'x' WHERE key = 'planned_runs'",
        "UPDATE meta SET value = '[' WHERE key = 'keys'",
        "UPDATE meta SET value = '../evil' WHERE key = 'name'",
        "UPDATE meta SET value = '{\"kind\":99,\"x\":\"\",\"y\":\"\",\"metric\":\"epsilon_m\","
        "\"title\":\"\"}' WHERE key = 'figure'",
        "UPDATE runs SET arm = 99", "DROP TABLE trajectories"}) {
    std::filesystem::remove(file_);
    begin().add({{0, 1, result(1.0)}});
    Database(file_, Database::Mode::write).execute(damage);
    EXPECT_THAT([&] { RunStore::open(file_); },
                ThrowsMessage<UsageError>(HasSubstr("damaged sweep's database")))
        << damage;
  }
}

TEST_F(Store, ThatIsADeviceOrAPipeIsRefused) {
  EXPECT_THAT([] { RunStore::open("/dev/zero"); },
              ThrowsMessage<UsageError>(HasSubstr("not a regular file")));
}

TEST_F(Store, ThatIsNotThereIsNamed) {
  EXPECT_THAT([&] { RunStore::open(file_); },
              ThrowsMessage<UsageError>(HasSubstr("there is no sweep's database")));
}

class Merge : public Store {
 protected:
  /// Runs of the two shards of two_arms(), one run of each arm in each.
  void make_shard(std::size_t index, bool complete = true, const Experiment& e = two_arms()) {
    RunStore store = begin(e, {index, 2});
    store.add({{0, index, result(1.0)}, {1, index, result(2.0)}});
    if (complete) store.set_complete();
  }
  std::filesystem::path target() const { return folder_ / "runs.sqlite"; }
  void refuses(const std::string& why) {
    EXPECT_THAT([&] { merge_shards(target(), {folder_}); },
                ThrowsMessage<UsageError>(HasSubstr(why)));
    EXPECT_FALSE(std::filesystem::exists(target()));
  }
};

TEST_F(Merge, HasTheSameRunsAsASweepInOnePiece) {
  make_shard(2);
  make_shard(1);
  merge_shards(target(), {folder_});
  const std::string merged = exported(RunStore::open(target()));
  std::filesystem::remove(target());
  RunStore whole = begin();
  whole.add({{0, 1, result(1.0)}, {1, 1, result(2.0)}, {0, 2, result(1.0)}, {1, 2, result(2.0)}});
  EXPECT_EQ(merged, exported(whole));
}

TEST_F(Merge, IsTheDatabaseOfTheWholeSweep) {
  make_shard(1);
  make_shard(2);
  merge_shards(target(), {folder_});
  const RunStore store = begin();  // the same experiment, without shards
  EXPECT_TRUE(store.is_complete());
  EXPECT_THAT(runs_of(store), SizeIs(4));
  EXPECT_EQ(runs_of(store).front().result, result(1.0));  // trajectory included
}

TEST_F(Merge, RefusesWithAShardMissing) {
  make_shard(2);
  refuses("shard 1/2 is missing");
}

TEST_F(Merge, RefusesAnIncompleteShard) {
  make_shard(1);
  make_shard(2, false);
  refuses("not complete");
}

TEST_F(Merge, RefusesShardsOfDifferentExperiments) {
  make_shard(1);
  Experiment other = two_arms();
  other.arms[0].scenario.get<ControllerSettings>().tau_s = 3.0;
  make_shard(2, true, other);
  refuses("grids differ");
}

TEST_F(Merge, RefusesAShardTwice) {
  make_shard(1);
  make_shard(2);
  const auto first = database_in(folder_, {1, 2});
  EXPECT_THAT(
      [&] {
        merge_shards(target(), {first, first});
      },
      ThrowsMessage<UsageError>(HasSubstr("does not go with")));
}

TEST_F(Merge, OverwritesNothing) {
  make_shard(1);
  make_shard(2);
  std::ofstream(target()) << "precious";
  EXPECT_THAT([&] { merge_shards(target(), {folder_}); },
              ThrowsMessage<UsageError>(HasSubstr("is there already")));
  EXPECT_EQ(std::filesystem::file_size(target()), 8U);
}

TEST_F(Merge, RefusesALogThatWouldBeReplayed) {
  make_shard(1);
  make_shard(2);
  std::ofstream(target().string() + "-wal") << "of a sweep that was killed";
  EXPECT_THAT([&] { merge_shards(target(), {folder_}); },
              ThrowsMessage<UsageError>(HasSubstr("runs.sqlite-wal is there already")));
}

TEST_F(Merge, NeedsShards) { refuses("no shard-*.sqlite"); }

}  // namespace
}  // namespace tether
