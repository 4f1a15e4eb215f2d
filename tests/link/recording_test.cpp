#include "doors/link/node/recording.hpp"

#include <gmock/gmock.h>

#include <vector>

#include "tests/support/folder.hpp"
#include "tests/support/refusal.hpp"

namespace tether::link {
namespace {

using ::testing::HasSubstr;
using tether::test::contents;

constexpr std::int64_t kSecond_ns = 1'000'000'000;

/// Rows sent a millisecond apart from `begin_s`; transit in ms, −1: lost.
path_fates_t fates(const std::vector<double>& transit_ms, double begin_s = 1e9) {
  path_fates_t m{};
  m.peer = "vehicle 7";
  m.path = "wifi";
  m.offset_known = 1;
  m.offset_min_ms = 1.0;
  m.offset_max_ms = 3.0;
  for (const double ms : transit_ms) {
    m.sent_ns.push_back(static_cast<std::int64_t>(begin_s) * kSecond_ns +
                        static_cast<std::int64_t>(m.sent_ns.size()) * 1'000'000);
    m.transit_ns.push_back(ms < 0.0 ? 0 : static_cast<std::int64_t>(ms * 1e6));
    m.lost.push_back(ms < 0.0 ? 1 : 0);
    m.anew.push_back(0);
  }
  m.count = static_cast<std::int32_t>(m.sent_ns.size());
  return m;
}

TEST(Recording, HasARowForEachDatagramWithItsDelay) {
  const tether::test::Folder folder;
  Recording recording({folder.path.string(), "", false});
  recording.take(fates({5.0, -1.0, -1.0, 0.0}));
  const std::string text = contents(folder.path / "vehicle_7-wifi.csv");
  EXPECT_THAT(text, HasSubstr("time_s,lost,delay_ms\n0.000000000,0,7.000000\n0.001000000,1,\n"
                              "0.002000000,1,\n0.003000000,0,2.000000\n"));
  EXPECT_THAT(recording.summary(), HasSubstr("50.00 % lost in 1 bursts (mean 2.00, longest 2)"));
  EXPECT_THAT(recording.summary(), HasSubstr("at most 7.000 ms, each ± 1.000 ms"));
}

TEST(Recording, ByOneClockTakesDelaysAsStamped) {
  const tether::test::Folder folder;
  Recording recording({folder.path.string(), "", true});
  recording.take(fates({5.0}));
  EXPECT_THAT(contents(folder.path / "vehicle_7-wifi.csv"), HasSubstr(",0,5.000000\n"));
  EXPECT_THAT(recording.summary(), HasSubstr("do not record it with --same-clock"));
}

TEST(Recording, TimesIncreaseWhateverTheClockDoes) {
  const tether::test::Folder folder;
  Recording recording({folder.path.string(), "", false});
  recording.take(fates({1.0, 1.0}, 1e9));
  recording.take(fates({1.0, 1.0}, 5e8));  // set back by years
  path_fates_t same = fates({1.0, 1.0}, 5e8);
  same.sent_ns[0] = same.sent_ns[1];  // pieces of one message
  same.anew[0] = 1;
  recording.take(same);
  EXPECT_THAT(contents(folder.path / "vehicle_7-wifi.csv"),
              HasSubstr("\n0.001000000,0,3.000000\n0.001000001,0,3.000000\n0.002000001,0,3.000000\n"
                        "0.002000002,0,3.000000\n0.002000003,0,3.000000\n"));
  EXPECT_THAT(recording.summary(), HasSubstr("of 1 stretch,"));
}

TEST(Recording, BeginsWhenTheOffsetIsKnownAndTakesOnlyWhomItIsAskedFor) {
  const tether::test::Folder folder;
  Recording recording({folder.path.string(), "vehicle 7", false});
  path_fates_t unknown = fates({1.0, 1.0});
  unknown.offset_known = 0;
  recording.take(unknown);
  path_fates_t other = fates({1.0});
  other.peer = "vehicle 8";
  recording.take(other);
  recording.take(fates({4.0}));
  EXPECT_THAT(contents(folder.path / "vehicle_7-wifi.csv"),
              HasSubstr("delay_ms\n0.000000000,0,6.000000\n"));
  EXPECT_THAT(recording.summary(), HasSubstr("2 datagrams are left out"));
  EXPECT_EQ(recording.summary().find("vehicle_8"), std::string::npos);
}

TEST(Recording, NeverOverwritesAndNamesTheFile) {
  const tether::test::Folder folder;
  folder.file("vehicle_7-wifi.csv", "yesterday's");
  Recording again({folder.path.string(), "", false});
  EXPECT_THAT(refusal_of([&] { again.take(fates({1.0})); }),
              HasSubstr("vehicle_7-wifi.csv: exists already"));
  Recording nowhere({(folder.path / "none").string(), "", false});
  EXPECT_THAT(refusal_of([&] { nowhere.take(fates({1.0})); }), HasSubstr("cannot be written"));
  const tether::test::Folder fresh;
  Recording twins({fresh.path.string(), "", false});
  path_fates_t other = fates({1.0});
  other.peer = "vehicle-7";
  twins.take(fates({1.0}));
  EXPECT_THAT(refusal_of([&] { twins.take(other); }), HasSubstr("two paths would be written here"));
}

}  // namespace
}  // namespace tether::link
