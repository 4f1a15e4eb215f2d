#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

#include "tests/autonomy/campaign/trial.hpp"
#include "tests/support/number_from.hpp"

namespace tether::test {
namespace {

struct Outcome {
  TrialTotals totals;
  std::vector<std::string> broken;
};

Outcome run_trials(std::uint64_t first, std::uint64_t count) {
  const unsigned threads = std::max(1U, std::thread::hardware_concurrency());
  std::vector<Outcome> parts(threads);
  std::atomic<std::uint64_t> next{first};
  std::vector<std::thread> workers;
  for (Outcome& part : parts) {
    workers.emplace_back([&part, &next, end = first + count] {
      for (std::uint64_t seed = next++; seed < end; seed = next++) {
        const std::string broken = run_trial(seed, part.totals);
        if (!broken.empty()) part.broken.push_back(broken);
      }
    });
  }
  for (std::thread& worker : workers) worker.join();
  Outcome all;
  for (const Outcome& part : parts) {
    all.totals.add(part.totals);
    all.broken.insert(all.broken.end(), part.broken.begin(), part.broken.end());
  }
  return all;
}

/// TETHER_TRIALS and TETHER_FIRST_SEED in the environment: others.
TEST(HandoverCampaign, NoRuleIsBrokenInSeededRuns) {
  const std::uint64_t count = number_from("TETHER_TRIALS", 250);
  const Outcome all = run_trials(number_from("TETHER_FIRST_SEED", 1), count);
  for (std::size_t i = 0; i < std::min<std::size_t>(all.broken.size(), 10); ++i) {
    ADD_FAILURE() << all.broken[i];
  }
  EXPECT_TRUE(all.broken.empty()) << all.broken.size() << " of " << count;
  const TrialTotals& t = all.totals;
  std::printf(
      "%lld runs: %lld protective stops, %lld requests, %lld setpoints by the law, %lld remote, "
      "%lld returns, %lld commands refused, %lld silences, %lld obstacles, %lld losses of "
      "localisation, "
      "nearest %.3f m\n",
      static_cast<long long>(t.runs), static_cast<long long>(t.protective_stops),
      static_cast<long long>(t.requests), static_cast<long long>(t.law_steps),
      static_cast<long long>(t.remote_steps), static_cast<long long>(t.returns),
      static_cast<long long>(t.refused), static_cast<long long>(t.silences),
      static_cast<long long>(t.obstacles), static_cast<long long>(t.localisation_losses),
      t.nearest_m);
  // The runs are worth it: whatever is forbidden had its chances.
  EXPECT_GT(t.protective_stops, t.runs);
  EXPECT_GT(t.requests, t.runs / 4);
  EXPECT_GT(t.remote_steps, t.runs * 10);
  EXPECT_GT(t.refused, t.runs * 10);
  EXPECT_GT(t.returns, t.runs / 100);
  EXPECT_GT(t.silences, t.runs / 10);
}

struct Guilty {
  Fault fault;
  const char* name;
  const char* rule;  ///< rule that reports it

  friend void PrintTo(const Guilty& guilty, std::ostream* out) { *out << guilty.name; }
};
class AFaultyDriver : public ::testing::TestWithParam<Guilty> {};

/// The finding in the first runs that have one.
TEST_P(AFaultyDriver, IsFoundByTheRuleThatItBreaks) {
  constexpr std::uint64_t kMost = 30;
  TrialTotals totals;
  std::string found;
  for (std::uint64_t seed = 1; seed <= kMost && found.empty(); ++seed) {
    found = run_trial(seed, totals, GetParam().fault);
  }
  EXPECT_THAT(found, ::testing::HasSubstr(GetParam().rule));
}

INSTANTIATE_TEST_SUITE_P(
    Handover, AFaultyDriver,
    ::testing::Values(
        Guilty{Fault::starts_early, "StartsEarly", "moves before t = 0"},
        Guilty{Fault::jumps, "Jumps", "the setpoint jumps"},
        Guilty{Fault::rolls_on, "RollsOn", "moves on without a driver"},
        Guilty{Fault::two_drivers, "TwoDrivers", "no rest between drivers"},
        Guilty{Fault::law_unasked, "LawUnasked", "the law drives, but not in AUTONOMOUS"},
        Guilty{Fault::remote_unasked, "RemoteUnasked", "driven remotely, but not in REMOTE"},
        Guilty{Fault::remote_forever, "RemoteForever", "no command that fits for too long"},
        Guilty{Fault::remote_fast, "RemoteFast", "too fast for remote driving"},
        Guilty{Fault::stops_late, "StopsLate", "m after a protective stop"},
        Guilty{Fault::sees_no_obstacles, "SeesNoObstacles", "touches what stood in view"}),
    [](const auto& info) { return info.param.name; });

}  // namespace
}  // namespace tether::test
