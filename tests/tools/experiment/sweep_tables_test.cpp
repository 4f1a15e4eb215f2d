#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <limits>
#include <optional>

#include "tests/tools/runs/run_files.hpp"
#include "tools/experiment/report/figure.hpp"
#include "tools/experiment/report/report.hpp"
#include "tools/experiment/report/tables.hpp"
#include "tools/experiment/sweep/export.hpp"

// Tables and means of sweeps whose results are written by the test.

namespace tether {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// Arms by (law, PRR), with the results of the seeds 1, 2, …; NaN: failed; above 15: lost.
struct HandMade {
  std::string law, prr;
  std::vector<double> epsilon_m;
};

class SweepTables : public ::testing::Test {
 protected:
  RunStore store_of(const std::vector<HandMade>& arms, std::vector<TableChoice> tables = {},
                    std::optional<FigureChoice> figure = std::nullopt) {
    Experiment e;
    e.figure = std::move(figure);
    e.name = "by_hand";
    e.keys = {"law", "PRR"};
    e.tables = std::move(tables);
    std::vector<StoredRun> runs;
    for (const HandMade& arm : arms) {
      e.arms.push_back({{{"law", '"' + arm.law + '"'}, {"PRR", '"' + arm.prr + '"'}}, {}});
      for (std::size_t i = 0; i < arm.epsilon_m.size(); ++i) {
        RunResult result;
        result.metrics.assign(result.metrics.size(), 0.5);
        result.metrics[0] = arm.epsilon_m[i];
        result.metrics[metric_number("lost").value()] = arm.epsilon_m[i] > 15.0 ? 1.0 : 0.0;
        if (std::isnan(arm.epsilon_m[i])) result.failure = "it broke";
        runs.push_back({e.arms.size() - 1, i + 1, result});
      }
      e.seeds.resize(std::max(e.seeds.size(), arm.epsilon_m.size()));
    }
    for (std::size_t i = 0; i < e.seeds.size(); ++i) e.seeds[i] = i + 1;
    RunStore store = RunStore::begin(own_.path / "runs.sqlite", e, {});
    store.add(runs);
    return store;
  }

  static TableChoice choice(TableChoice::Kind kind) {
    TableChoice choice;
    choice.kind = kind;
    choice.title = "Manual";
    choice.metric = "epsilon_m";
    return choice;
  }

  test::Folder own_;
};

constexpr double kFailed = std::numeric_limits<double>::quiet_NaN();

TEST_F(SweepTables, MeansGoAcrossByTheirColumns) {
  TableChoice by_prr = choice(TableChoice::Kind::means);
  by_prr.columns = {"PRR"};
  const RunStore store = store_of(
      {{"a", "1", {2, 2, 2}}, {"a", "0.5", {3, 3, kFailed}}, {"b", "1", {0.25, 0.25, 0.25}}},
      {by_prr});
  const auto tables = tables_of(RunStore::open(store.file()));  // the choice is stored, too
  ASSERT_EQ(tables.size(), 1U);
  EXPECT_EQ(tables[0].title, "Manual");
  EXPECT_THAT(tables[0].rows, ElementsAre(ElementsAre("law", "PRR 1", "PRR 0.5"),
                                          ElementsAre("a", "2 [2, 2]", "3 [3, 3]"),
                                          ElementsAre("b", "0.25 [0.25, 0.25]", "")));
  EXPECT_EQ(tables[0].note, "ε [m]: mean [its 95 % interval]; n = 2 to 3 runs a cell");
  EXPECT_EQ(tables[0].csv,
            "law,PRR,mean,low,high,n,failed,survivors_mean,survivors_low,survivors_high,lost,"
            "lost_low,lost_high\na,1,2,2,2,3,0,2,2,2,0,0,0.707598\n"
            "a,0.5,3,3,3,2,1,3,3,3,0,0,0.841886\nb,1,0.25,0.25,0.25,3,0,0.25,0.25,0.25,0,0,"
            "0.707598\n");
}

TEST_F(SweepTables, WhereVehiclesWereLostTheMeanIsThatOfTheOthers) {
  TableChoice by_prr = choice(TableChoice::Kind::means);
  by_prr.columns = {"PRR"};
  const RunStore store = store_of(
      {{"a", "1", {2, 2, 2}}, {"a", "0.5", {3, 22, 3, kFailed}}, {"a", "0.1", {20, 22}}}, {by_prr});
  const SweepTable table = tables_of(store).at(0);
  EXPECT_THAT(table.rows[1], ElementsAre("2 [2, 2]", "3 [3, 3], lost 1/3 [0.84, 90.6] %",
                                         "-, lost 2/2 [15.8, 100] %"));
  EXPECT_THAT(table.note, HasSubstr("3 of 8 vehicles were lost"));
  EXPECT_THAT(table.csv, HasSubstr("\n0.5,9.33333,"));
  EXPECT_THAT(table.csv, HasSubstr(",3,1,3,3,3,0.333333,0.00840376,0.905701\n"));
}

TEST_F(SweepTables, OfWhatIsNoErrorTheMeanIsThatOfAllVehicles) {
  TableChoice sent = choice(TableChoice::Kind::means);
  sent.metric = "uplink_sent";
  const RunStore store = store_of({{"a", "1", {2, 22}}, {"a", "0.5", {2, 2}}}, {sent});
  const SweepTable table = tables_of(store).at(0);
  EXPECT_EQ(table.rows[1].back(), "0.5 [0.5, 0.5]");
  EXPECT_THAT(table.note, ::testing::Not(HasSubstr("lost")));
}

TEST_F(SweepTables, TheShareOfLostVehiclesHasTheIntervalOfAShare) {
  TableChoice lost = choice(TableChoice::Kind::means);
  lost.metric = "lost";
  const RunStore store = store_of({{"a", "1", {2, 2, 2}}, {"a", "0.5", {3, 22, 3}}}, {lost});
  const SweepTable table = tables_of(store).at(0);
  EXPECT_THAT(table.rows[1].back(), "0 [0, 0.708]");
  EXPECT_THAT(table.rows[2].back(), "0.333 [0.0084, 0.906]");
}

TEST_F(SweepTables, RatiosWhereVehiclesWereLostAreThoseOfTheOthers) {
  TableChoice ratio = choice(TableChoice::Kind::ratio);
  ratio.key = "law";
  ratio.over = "PID";
  ratio.under = "new";
  ratio.limit = 1.0;
  const RunStore store = store_of({{"PID", "1", {4, 22, 4, 4}},
                                   {"new", "1", {2, 2, 22, 2}},
                                   {"PID", "0.5", {22, 22}},
                                   {"new", "0.5", {2, 2}}},
                                  {ratio});
  const SweepTable table = tables_of(store).at(0);
  EXPECT_THAT(table.rows[1], ElementsAre("1", HasSubstr("4 [4, 4], lost 1/4 ["),
                                         HasSubstr("2 [2, 2], lost 1/4 ["), "2 [2, 2]", "yes"))
      << "of the seeds 1 and 4";
  EXPECT_THAT(table.rows[2], ElementsAre("0.5", HasSubstr("-, lost 2/2 ["), "-", "-", "-"));
  EXPECT_THAT(table.csv, HasSubstr("\n1,4,4,4,2,2,2,2,2,2,2,1,1\n0.5,,,,,,,,,,0,2,0\n"));
  EXPECT_THAT(table.note, HasSubstr("of the seeds on which neither was, and the share of lost ones "
                                    "with its exact 95 % interval: 4 of 12 vehicles were lost"));
}

TEST_F(SweepTables, OfAllCombinationsHasTheLostOnesWhereThereAreSome) {
  const std::vector<HandMade> healthy{{"a", "1", {2, 2}}};
  store_of(healthy);
  write_report(own_.path, RiskDefinition::whole_run);
  EXPECT_THAT(test::contents(own_.path / "report.md"), ::testing::Not(HasSubstr("lost [95 %]")));
  std::filesystem::remove(own_.path / "runs.sqlite");
  store_of({{"a", "1", {2, 2}}, {"a", "0.5", {3, 22, 3}}});
  write_report(own_.path, RiskDefinition::whole_run);
  EXPECT_THAT(test::contents(own_.path / "report.md"),
              AllOf(HasSubstr("lost [95 %] | mean of the others [95 %]"), HasSubstr("two humps"),
                    HasSubstr("| 1/3 [0.84, 90.6] % | 3 [3, 3]")));
}

TEST_F(SweepTables, AKeyThatIsTheSameInAllArmsIsNoColumn) {
  TableChoice all = choice(TableChoice::Kind::means);
  all.columns = {"PRR"};
  all.where = {{"PRR", {"1"}}};
  const RunStore store = store_of({{"a", "1", {2, 4}}, {"b", "1", {3, 3}}, {"a", "0.5", {9, 9}}});
  const SweepTable table = means_table(SweepData(store, "epsilon_m"), all);
  EXPECT_THAT(table.rows[0], ElementsAre("law", "mean"));
  EXPECT_THAT(table.rows[1], ElementsAre("a", HasSubstr("3 [")));
  EXPECT_THAT(table.rows[2], ElementsAre("b", "3 [3, 3]"));
  EXPECT_EQ(table.rows.size(), 3U);
}

TEST_F(SweepTables, ARatioIsThatOfTheMeansAndHoldsIfItsWholeIntervalDoes) {
  TableChoice ratio = choice(TableChoice::Kind::ratio);
  ratio.key = "law";
  ratio.over = "PID";
  ratio.under = "new";
  ratio.limit = 10.0;
  const std::vector<double> tens(12, 10.0), ones(12, 1.0), twos(12, 2.0);
  std::vector<double> uneven(12, 0.5);  // mean 0.9
  uneven[0] = 5.3;
  const RunStore store = store_of({{"PID", "1", tens},
                                   {"PID", "0.5", tens},
                                   {"PID", "0.2", tens},
                                   {"new", "1", ones},
                                   {"new", "0.5", twos},
                                   {"new", "0.2", uneven}});
  const SweepTable table = ratio_table(SweepData(store, "epsilon_m"), ratio);
  EXPECT_THAT(table.rows[0], ElementsAre("PRR", "PID", "new", "ratio", "≥ 10"));
  EXPECT_THAT(table.rows[1], ElementsAre("1", "10 [10, 10]", "1 [1, 1]", "10 [10, 10]", "yes"));
  EXPECT_THAT(table.rows[2], ElementsAre("0.5", "10 [10, 10]", "2 [2, 2]", "5 [5, 5]", "no"));
  EXPECT_THAT(table.rows[3], ElementsAre("0.2", "10 [10, 10]", HasSubstr("0.9 ["),
                                         HasSubstr("11.1 ["), "mean only"));
  EXPECT_THAT(table.csv, HasSubstr("\n1,10,10,10,1,1,1,10,10,10,12,0,0\n"));
}

TEST_F(SweepTables, TheLimitIsPassedWhereTheLineBetweenTwoMeansCrossesIt) {
  TableChoice limit = choice(TableChoice::Kind::limit);
  limit.key = "PRR";  // the size of whatever it is
  limit.limit = 1.0;
  const RunStore store = store_of({{"crosses", "20", {9, 9}},
                                   {"crosses", "5", {0.5, 0.5}},
                                   {"crosses", "10", {2, 2}},
                                   {"never", "5", {0.5, 0.5}},
                                   {"never", "10", {0.9, 0.9}},
                                   {"at once", "5", {1, 1}},
                                   {"at once", "10", {4, 4}}});
  const SweepTable table = limit_table(SweepData(store, "epsilon_m"), limit);
  EXPECT_THAT(table.rows[0], ElementsAre("law", "ε [m] reaches 1 at", "mean before", "mean then"));
  // 5 + 5 · (1 − 0.5)/(2 − 0.5)
  EXPECT_THAT(table.rows[1],
              ElementsAre("crosses", "about 6.67, between 5 and 10", "0.5 [0.5, 0.5]", "2 [2, 2]"));
  EXPECT_THAT(table.rows[2], ElementsAre("never", "not up to 10", "0.9 [0.9, 0.9]", "-"));
  EXPECT_THAT(table.rows[3], ElementsAre("at once", "at 5 already", "-", "1 [1, 1]"));
  EXPECT_THAT(table.csv, HasSubstr("\ncrosses,5,10,6.66667,0.5,2\nnever,10,,,0.9,\n"));
}

TEST_F(SweepTables, AreInTheReportAndBesideItAsData) {
  TableChoice by_prr = choice(TableChoice::Kind::means);
  by_prr.columns = {"PRR"};
  store_of({{"a|b", "1", {2, 2}}, {"a|b", "0.5", {3, 3}}, {"c", "1", {4, 4}}}, {by_prr});
  write_report(own_.path, RiskDefinition::whole_run);
  EXPECT_THAT(test::contents(own_.path / "report.md"),
              HasSubstr("### Manual\n\n| law | PRR 1 | PRR 0.5 |\n|-|-|-|\n"
                        "| a\\|b | 2 [2, 2] | 3 [3, 3] |\n| c | 4 [4, 4] |  |\n\nε [m]: mean"));
  EXPECT_THAT(test::contents(own_.path / "report.html"),
              AllOf(HasSubstr("<h3>Manual</h3>"), HasSubstr("<td class=\"number\">3 [3, 3]")));
  EXPECT_THAT(test::contents(own_.path / "by_hand_table1.csv"),
              AllOf(HasSubstr("law,PRR,mean,low,high,n,failed,"), HasSubstr("\na|b,1,2,2,2,2,0,"),
                    HasSubstr("\na|b,0.5,3,3,3,2,0,"), HasSubstr("\nc,1,4,4,4,2,0,")));
}

TEST_F(SweepTables, ExportedMeansHaveARowForEachArmWithIntervalsAndFailures) {
  const RunStore store = store_of(
      {{"a, b", "1", {2, 2, 2}}, {"c", "0.5", {3, kFailed, kFailed}}, {"d", "0.5", {kFailed}}});
  std::string text;
  export_means(store, [&text](const std::string& more) { text += more; });
  std::vector<std::string> rows;
  std::istringstream in(text);
  for (std::string row; std::getline(in, row);) rows.push_back(row);
  ASSERT_EQ(rows.size(), 4U);
  EXPECT_THAT(rows[0], ::testing::StartsWith("arm,law,PRR,plant,runs,failed,epsilon_m,"
                                             "epsilon_m_low,epsilon_m_high,rmse_m,"));
  EXPECT_THAT(rows[1], ::testing::StartsWith("0,\"a, b\",1,ode,3,0,2,2,2,0.5,0.5,0.5,"));
  EXPECT_THAT(rows[2], ::testing::StartsWith("1,c,0.5,ode,1,2,3,,,0.5,,,"))
      << "one run: no interval";
  EXPECT_THAT(rows[3], ::testing::StartsWith("2,d,0.5,ode,0,1,,,,,,,")) << "no run, no mean";
}

TEST_F(SweepTables, ExportedSharesOfLostVehiclesHaveTheExactInterval) {
  const RunStore store = store_of({{"a", "1", {3, 22, 3}}, {"a", "0.5", {2, 2, 2}}});
  std::string text;
  export_means(store, [&text](const std::string& more) { text += more; });
  EXPECT_THAT(text,
              AllOf(HasSubstr(",0.333333,0.00840376,0.905701,"), HasSubstr(",0,0,0.707598,")));
}

TEST(MeanRatio, IsOverTheCommonSeeds) {
  const std::vector<SeededValue> x{{1, 4.0}, {2, 8.0}, {3, 100.0}, {4, kFailed}};
  const std::vector<SeededValue> y{{1, 1.0}, {2, 2.0}, {4, 1.0}};
  const MeanRatio r = mean_ratio(x, y, 0.95, 1);
  EXPECT_DOUBLE_EQ(r.ratio, 4.0);
  EXPECT_EQ(r.first.n, 2U);
  EXPECT_EQ(r.left_out, 2U);
  // Each run's ratio is the same, so that of any resample is.
  EXPECT_DOUBLE_EQ(r.interval.low, 4.0);
  EXPECT_DOUBLE_EQ(r.interval.high, 4.0);
  EXPECT_TRUE(std::isnan(mean_ratio({}, y, 0.95, 1).ratio));
}

TEST(MeanRatio, CommonLuckCancels) {
  std::vector<SeededValue> x, y;
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    const double luck = 1.0 + static_cast<double>(seed % 7);  // 1 to 7
    x.push_back({seed, 10.0 * luck + (seed % 2 == 0 ? 0.5 : -0.5)});
    y.push_back({seed, luck});
  }
  const MeanRatio r = mean_ratio(x, y, 0.95, 1);
  EXPECT_NEAR(r.ratio, 10.0, 0.01);
  // The rest, ±0.5 on a mean of 40 over 30 runs: an error of 0.023; of luck alone it would be 1.
  EXPECT_GT(half_width(r.interval), 0.02);
  EXPECT_LT(half_width(r.interval), 0.08);
}

TEST_F(SweepTables, ACurveOverNamesOfAnExpressionLinksToItsFiles) {
  FigureChoice figure;
  figure.x = "law";
  figure.y = "PRR";
  figure.metric = "100 * epsilon_m + rmse_m";
  figure.y_label = "something [cm]";
  {
    const RunStore store = store_of(
        {{"PID", "1", {1.0, 2.0}}, {"plans", "1", {0.1, 0.2}}, {"plans", "0.5", {0.3, 0.5}}}, {},
        figure);
    const SweepData data(store, figure.metric);
    EXPECT_DOUBLE_EQ(data.arms()[0].runs[0].value, 100.5);
    EXPECT_DOUBLE_EQ(data.arms()[2].summary.mean, 40.5);
    EXPECT_THAT(names_of(data, figure), ElementsAre("PID", "plans"));
    EXPECT_EQ(x_of(data, figure, 2), 2.0);
  }
  write_report(own_.path, RiskDefinition::whole_run);
  const std::string html = test::contents(own_.path / "report.html");
  EXPECT_THAT(html, HasSubstr(R"("names":["PID","plans"])"));
  EXPECT_THAT(html, HasSubstr(R"("y_label":"something [cm]")"));
  for (const char* kind : {"csv", "gp", "pdf", "png", "svg", "tex"}) {
    EXPECT_THAT(html, HasSubstr(fmt::format("<a href=\"./by_hand.{0}\">by_hand.{0}</a>", kind)));
  }
  EXPECT_THAT(test::contents(own_.path / "by_hand.svg"),
              AllOf(HasSubstr("plans"), HasSubstr("something [cm]")));
}

TEST(Labels, AreWordsInsteadOfKeys) {
  EXPECT_EQ(label_of_value("controller.law", "pid"), "PID");
  EXPECT_EQ(label_of_value("controller.law", "tracking_compensated"), "tracking compensated");
  EXPECT_EQ(label_of_value("channel.uplink.prr", "0.45"), "PRR 0.45");
  EXPECT_EQ(label_of_value("channel.delay_ms", "100"), "δ 100 ms");
  EXPECT_EQ(label_of_value("delay_ms", "100"), "δ 100 ms");
  EXPECT_EQ(label_of_value("controller.tau_s", "2"), "τ 2 s");
  EXPECT_EQ(label_of_value("sensor.rate_hz", "20"), "sensor rate 20 Hz");
  EXPECT_EQ(label_of_value("vehicle.accel_mps2", "3"), "vehicle accel 3 m/s²");
  EXPECT_EQ(label_of_value("link.bits_per_s", "9"), "link 9 bit/s");
  EXPECT_EQ(label_of_value("controller.preload", "true"), "controller preload");
  EXPECT_EQ(label_of_value("controller.preload", "false"), "no controller preload");
  EXPECT_EQ(label_of_value("channel.trace.file", "traces/hall 3.csv"), "hall 3");
  EXPECT_EQ(label_of_value("law", "PID, 1/1 Hz"), "PID, 1/1 Hz");
  EXPECT_EQ(label_of_value("size", "5"), "5") << "an axis with a name of its own";
}

}  // namespace
}  // namespace tether
