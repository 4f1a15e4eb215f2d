#include <cmath>
#include <fstream>
#include <utility>

#include "common/base/errors.hpp"
#include "tests/tools/experiment/store.hpp"

namespace tether {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::SizeIs;
using ::testing::ThrowsMessage;

TEST_F(Store, NamesTheRowWhosePayloadHasChanged) {
  const std::pair<const char*, const char*> changes[] = {
      {"UPDATE runs SET epsilon_m = 1.0000000000000002 WHERE seed = 2",
       "the run of combination 0, seed 2"},
      {"UPDATE runs SET epsilon_m = NULL WHERE seed = 2", "the run of combination 0, seed 2"},
      {"UPDATE runs SET seed = 4 WHERE seed = 2", "the run of combination 0, seed 4"},
      {"UPDATE runs SET failure = 'x' WHERE seed = 2", "the run of combination 0, seed 2"},
      {"UPDATE runs SET failure = 'it brake' WHERE seed = 3", "the run of combination 0, seed 3"},
      {"UPDATE trajectories SET points = zeroblob(64) WHERE seed = 2",
       "the trajectory of the run of combination 0, seed 2"},
      {"UPDATE arms SET settings = '[[\"channel.prr\",\"0\"]]' WHERE arm = 1", "combination 1"},
      {"UPDATE meta SET value = 'others' WHERE key = 'name'", "meta name"}};
  for (const auto& [change, row] : changes) {
    std::filesystem::remove(file_);
    begin().add({{0, 1, result(0.0)}, {0, 2, result(1.0)}, {0, 3, failure("it broke")}});
    EXPECT_THAT(runs_of(RunStore::open(file_)), SizeIs(3));
    Database(file_, Database::Mode::write).execute(change);
    EXPECT_THAT([&] { runs_of(RunStore::open(file_)); },
                ThrowsMessage<UsageError>(AllOf(HasSubstr(file_.string()), HasSubstr(row),
                                                HasSubstr("checksum"), HasSubstr("repeat"))))
        << change;
  }
}

TEST_F(Store, NamesARunWhoseTrajectoryIsMissing) {
  begin().add({{0, 1, result(0.0)}, {0, 2, failure("it broke")}});
  EXPECT_THAT(runs_of(RunStore::open(file_)), SizeIs(2));
  Database(file_, Database::Mode::write).execute("DELETE FROM trajectories");
  EXPECT_THAT([&] { runs_of(RunStore::open(file_)); },
              ThrowsMessage<UsageError>(AllOf(
                  HasSubstr(file_.string()),
                  HasSubstr("the trajectory of the run of combination 0, seed 1 is missing"))));
}

// A thousand databases, each with one bit flipped: none gives other numbers without an error.
TEST_F(Store, NeverGivesOtherNumbersBecauseOfAFlippedBit) {
  {
    RunStore store = begin();
    for (std::uint64_t seed = 1; seed <= 20; ++seed) store.add({{0, seed, result(0.1)}});
    store.flush();
  }
  std::string whole;
  {
    std::ifstream in(file_, std::ios::binary);
    whole.assign(std::istreambuf_iterator<char>(in), {});
  }
  const std::string right = exported(RunStore::open(file_));
  int refused = 0;
  for (std::size_t i = 0; i < 1000; ++i) {
    std::string damaged = whole;
    const std::size_t bit = i * 7919 * 8191 % (whole.size() * 8);
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ 1 << bit % 8);
    const auto copy = folder_ / "damaged.sqlite";
    std::ofstream(copy, std::ios::binary) << damaged;
    try {
      const RunStore store = RunStore::open(copy);
      runs_of(store);
      EXPECT_EQ(exported(store), right) << "bit " << bit;
    } catch (const std::exception&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 100);
}

TEST_F(Store, WithoutChecksumsIsReadButNotGoneOnWith) {
  begin().add({{0, 1, result(1.0)}});
  {
    Database old(file_, Database::Mode::write);
    old.execute(
        "ALTER TABLE runs DROP COLUMN sum; ALTER TABLE arms DROP COLUMN sum;"
        "ALTER TABLE trajectories DROP COLUMN sum; ALTER TABLE meta DROP COLUMN sum;"
        "UPDATE meta SET value = '1' WHERE key = 'format'");
  }
  EXPECT_EQ(runs_of(RunStore::open(file_)).at(0).result, result(1.0));
  EXPECT_THAT([&] { begin(); }, ThrowsMessage<UsageError>(HasSubstr("without checksums")));
}

// A database without the newer metrics, with the checksums that it had then.
TEST_F(Store, FromBeforeAMetricIsReadWithoutItButNotGoneOnWith) {
  begin().add({{0, 1, failure("it broke")}, {1, 1, failure("it broke, too")}});
  Database(file_, Database::Mode::write)
      .execute("ALTER TABLE runs DROP COLUMN lost; ALTER TABLE runs DROP COLUMN return_s");
  EXPECT_THAT(runs_of(RunStore::open(file_)), SizeIs(2));
  EXPECT_THAT([&] { begin(); },
              ThrowsMessage<UsageError>(HasSubstr("without the metrics lost, return_s")));
}

TEST_F(Store, WithoutChecksumsMayLackAMetric) {
  begin().add({{0, 1, result(1.0)}});
  {
    Database old(file_, Database::Mode::write);
    old.execute(
        "ALTER TABLE runs DROP COLUMN lost; ALTER TABLE runs DROP COLUMN sum;"
        "ALTER TABLE arms DROP COLUMN sum; ALTER TABLE trajectories DROP COLUMN sum;"
        "ALTER TABLE meta DROP COLUMN sum; UPDATE meta SET value = '1' WHERE key = 'format'");
  }
  const RunResult read = runs_of(RunStore::open(file_)).at(0).result;
  EXPECT_EQ(read.metrics[0], 1.0);
  EXPECT_TRUE(std::isnan(read.metrics[metric_number("lost").value()]));
}

TEST_F(Store, DoesNotTakeALostColumnForAnOlderVersion) {
  begin().add({{0, 1, result(1.0)}});
  Database(file_, Database::Mode::write).execute("ALTER TABLE runs DROP COLUMN lost");
  EXPECT_THAT([&] { runs_of(RunStore::open(file_)); },
              ThrowsMessage<UsageError>(HasSubstr("checksum")));
}

}  // namespace
}  // namespace tether
