#include "tools/experiment/sweep/prediction.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <random>

#include "common/base/errors.hpp"
#include "tests/tools/experiment/store.hpp"
#include "tools/base/replacing_output.hpp"

// Predictions from a sweep, and their comparison with measurements.

namespace tether {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string refusal(const std::function<void()>& act) {
  try {
    act();
  } catch (const UsageError& error) {
    return error.what();
  }
  return "not refused";
}

class PredictionTest : public Store {
 protected:
  /// Both arms of two_arms() with these errors, of seeds from `first` on; above 15 m: lost.
  RunStore store_of(const std::vector<std::vector<double>>& epsilon_m, std::uint64_t first = 1,
                    bool complete = true) {
    Experiment e = two_arms();
    e.seeds.clear();
    for (std::uint64_t i = 0; i < epsilon_m.front().size(); ++i) e.seeds.push_back(first + i);
    std::vector<StoredRun> runs;
    for (std::size_t arm = 0; arm < 2; ++arm) {
      for (std::size_t i = 0; i < epsilon_m[arm].size(); ++i) {
        RunResult r = result(epsilon_m[arm][i]);
        r.metrics[metric_number("lost").value()] = epsilon_m[arm][i] > 15.0 ? 1.0 : 0.0;
        runs.push_back({arm, e.seeds[i], std::isnan(epsilon_m[arm][i]) ? failure("broke") : r});
      }
    }
    RunStore store = RunStore::begin(folder_ / fmt::format("{}.sqlite", stores_++), e, Shard{});
    store.add(runs);
    if (complete) store.set_complete();
    return store;
  }
  std::string written(const std::string& text, const std::string& name = "p.json") {
    write_file(folder_ / name, text);
    return (folder_ / name).string();
  }

 private:
  int stores_ = 0;
};

std::vector<double> count_up(int n, double from = 1.0) {
  std::vector<double> values;
  for (int i = 0; i < n; ++i) values.push_back(from + i * 0.01);
  return values;
}

TEST_F(PredictionTest, PredictsOneNewRunBetweenOrderStatisticsAndCountsTheLost) {
  std::vector<double> second = count_up(79);
  second[3] = 22.0;          // lost
  second[5] = std::nan("");  // failed
  const Prediction p = predict(store_of({count_up(79), second}), "epsilon_m");
  ASSERT_EQ(p.arms.size(), 2U);
  EXPECT_EQ(p.arms[0].beyond, 2U);
  EXPECT_DOUBLE_EQ(p.arms[0].coverage(), 1.0 - 4.0 / 80.0);
  EXPECT_DOUBLE_EQ(p.arms[0].interval.low, 1.01);
  EXPECT_DOUBLE_EQ(p.arms[0].interval.high, 1.77);
  EXPECT_EQ(p.arms[1].runs, 78U);
  EXPECT_EQ(p.arms[1].lost, 1U);
  EXPECT_EQ(p.arms[1].values, 77U);
  EXPECT_EQ(p.arms[1].beyond, 1U) << "2 of 78 on each side are more than 5 %";
}

TEST_F(PredictionTest, RefusesASweepThatIsNotComplete) {
  const RunStore store = store_of({count_up(5), count_up(5)}, 1, false);
  EXPECT_THAT(refusal([&] { predict(store, "epsilon_m"); }), HasSubstr("is not complete"));
}

TEST_F(PredictionTest, IsReadAsItWasWrittenAndNotOnceItWasChanged) {
  const Prediction p = predict(store_of({count_up(30), count_up(30, 2.0)}), "epsilon_m");
  const std::string text = to_json(p);
  EXPECT_EQ(read_prediction(written(text)), p);
  EXPECT_EQ(to_json(read_prediction(written(text))), text);
  for (const auto& [from, to] : {std::pair{"\"lost\": 0", "\"lost\": 1"}, std::pair{"1.0", "1.1"},
                                 std::pair{"two_arms", "two_arma"}}) {
    std::string changed = text;
    changed.replace(changed.find(from), std::string(from).size(), to);
    EXPECT_THAT(refusal([&] { read_prediction(written(changed)); }),
                HasSubstr("was changed after"));
  }
  for (const std::string& none : {std::string("{"), std::string("[]"), text.substr(0, 300),
                                  std::string(R"({"tether_prediction": 2})")}) {
    EXPECT_THAT(refusal([&] { read_prediction(written(none)); }), HasSubstr("not a prediction"));
  }
}

TEST_F(PredictionTest, IsNotCheckedByItsOwnRuns) {
  const Prediction p = predict(store_of({count_up(30), count_up(30)}), "epsilon_m");
  const RunStore same = store_of({count_up(5), count_up(5)}, 30);
  EXPECT_THAT(refusal([&] { measured_in(same, p); }), HasSubstr("seed 30 is one of"));
  EXPECT_EQ(measured_in(store_of({count_up(5), count_up(5)}, 31), p).size(), 2U);
}

TEST_F(PredictionTest, HoldsForTheSameLawAndNotForAShiftOrForLosses) {
  const Prediction p = predict(store_of({count_up(79), count_up(79)}), "epsilon_m");
  const auto checked = [&](const std::vector<double>& second) {
    const RunStore store = store_of({count_up(20, 1.2), second}, 1000);
    return check_prediction(p, measured_in(store, p));
  };
  for (const CheckedArm& arm : checked(count_up(20, 1.3))) {
    EXPECT_EQ(arm.within, 20U);
    EXPECT_TRUE(arm.within_holds && arm.lost_holds);
  }
  const auto shifted = checked(count_up(20, 1.72));
  EXPECT_EQ(shifted[1].within, 6U);
  EXPECT_TRUE(shifted[0].within_holds);
  EXPECT_FALSE(shifted[1].within_holds);
  std::vector<double> some_lost = count_up(20, 1.2);
  for (int i = 0; i < 6; ++i) some_lost[i] = 22.0;
  const auto lost = checked(some_lost);
  EXPECT_TRUE(lost[1].within_holds);
  EXPECT_EQ(lost[1].lost, 6U);
  EXPECT_FALSE(lost[1].lost_holds);
}

TEST_F(PredictionTest, ToleratesADifferenceThatDoesNotMatter) {
  const std::vector<double> same(30, 1.732);
  const RunStore simulated = store_of({same, same});
  const RunStore measured = store_of({std::vector<double>(30, 1.733), same}, 100);
  for (const double tolerance_m : {0.0, 0.01}) {
    const Prediction p = predict(simulated, "epsilon_m", tolerance_m);
    EXPECT_EQ(read_prediction(written(to_json(p))), p);
    const auto checked = check_prediction(p, measured_in(measured, p));
    EXPECT_EQ(checked[0].within_holds, tolerance_m > 0.0);
    EXPECT_TRUE(checked[1].within_holds);
  }
}

TEST_F(PredictionTest, TakesATableFromTheFloor) {
  const Prediction p = predict(store_of({count_up(79), count_up(79)}), "epsilon_m");
  const auto measured = measured_in_table(
      written("day, channel.prr, epsilon_m, lost\n1, 0.5, 1.25, 0\n1, 1.0, 1.3, 0\n\n"
              "2, 0.50, , 1\n",
              "floor.csv"),
      p);
  ASSERT_EQ(measured.size(), 2U);
  EXPECT_EQ(measured[0].runs, 2U);
  EXPECT_EQ(measured[0].lost, 1U);
  EXPECT_THAT(measured[0].values, ElementsAre(1.25));
  EXPECT_EQ(check_prediction(p, measured).size(), 2U);
  const auto why = [&](const std::string& table) {
    return refusal([&] { check_prediction(p, measured_in_table(written(table, "t.csv"), p)); });
  };
  EXPECT_THAT(why("channel.prr,lost\n1,0\n"), HasSubstr("line 1: no column \"epsilon_m\""));
  EXPECT_THAT(why("epsilon_m\n1\n"), HasSubstr("line 1: no column \"channel.prr\""));
  EXPECT_THAT(why("channel.prr,epsilon_m\n1,1.2,3\n"), HasSubstr("line 2: 3 cells"));
  EXPECT_THAT(why("channel.prr,epsilon_m\n1,nan\n"),
              HasSubstr("line 2: column \"epsilon_m\" must be a finite"));
  EXPECT_THAT(why("channel.prr,epsilon_m,lost\n1,1.2,no\n"),
              HasSubstr("line 2: column \"lost\" must be 0 or 1"));
  EXPECT_THAT(why("channel.prr,epsilon_m\n0.7,1.2\n"),
              HasSubstr("channel.prr = 0.7: was measured, and not predicted"));
  EXPECT_THAT(why("channel.prr,epsilon_m\n"), HasSubstr("nothing was measured"));
}

TEST(PredictionTests, HaveTheProbabilitiesOfTheLiterature) {
  // One new value of 39 + 1 is the smallest or the largest once in 20 times.
  EXPECT_NEAR(probability_of_so_few_within(0, 1, 39, 1), 0.05, 1e-12);
  EXPECT_NEAR(probability_of_so_few_within(20, 20, 30, 1), 1.0, 1e-12);
  // Fisher's lady tasting tea, 3 of 4 cups; and R's fisher.test(matrix(c(8, 1, 2, 5), 2)).
  EXPECT_NEAR(fisher_exact(3, 4, 1, 4), 0.48571, 1e-5);
  EXPECT_NEAR(fisher_exact(8, 10, 1, 6), 0.03497, 1e-5);
  EXPECT_NEAR(fisher_exact(0, 30, 0, 20), 1.0, 1e-9);
  EXPECT_THAT(not_rejected_by_holm({0.01, 0.04, 0.03, 0.005}, 0.05),
              ElementsAre(false, true, true, false));
}

TEST(PredictionTests, RejectARightPredictionInOneOfTwentyAtMost) {
  // Skewed values; of 2000 comparisons of five settings 5 % and three standard errors may fail.
  std::mt19937_64 random(20261128);  // NOLINT: a fixed seed
  std::lognormal_distribution<double> law(0.0, 1.0);
  constexpr int kComparisons = 2000;
  int rejected = 0;
  for (int i = 0; i < kComparisons; ++i) {
    Prediction p;
    std::vector<MeasuredArm> measured;
    for (int arm = 0; arm < 5; ++arm) {
      std::vector<double> values(30);
      for (double& value : values) value = law(random);
      std::ranges::sort(values);
      const std::vector<KeyValue> settings{{"channel.prr", std::to_string(arm)}};
      p.arms.push_back({settings, 30, 0, 30, 1, {values.front(), values.back()}});
      MeasuredArm& m = measured.emplace_back(MeasuredArm{settings, 20, 0, {}});
      for (int k = 0; k < 20; ++k) m.values.push_back(law(random));
    }
    bool holds = true;
    for (const CheckedArm& arm : check_prediction(p, measured)) holds = holds && arm.within_holds;
    rejected += holds ? 0 : 1;
  }
  EXPECT_LT(rejected, kComparisons * 0.05 + 3.0 * std::sqrt(kComparisons * 0.05 * 0.95));
}

}  // namespace
}  // namespace tether
