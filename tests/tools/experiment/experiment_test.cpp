#include "tools/experiment/sweep/experiment.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <filesystem>

#include "common/scenario/run_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "netem/channel/settings.hpp"
#include "tests/tools/experiment/file.hpp"
#include "tools/runs/metric.hpp"

namespace tether {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

using test::ExperimentFile;
using test::texts;

TEST_F(ExperimentFile, CrossesTheGridInItsOrderAndTheLastKeyVariesFastest) {
  const Experiment experiment = load(R"(
seeds = 2
[grid]
channel.prr = [1, 0.5]
"controller.tau_s" = { from = 1.0, to = 2.0, step = 0.5 }
)");
  EXPECT_THAT(texts(experiment), ElementsAre("channel.prr = 1, controller.tau_s = 1",
                                             "channel.prr = 1, controller.tau_s = 1.5",
                                             "channel.prr = 1, controller.tau_s = 2",
                                             "channel.prr = 0.5, controller.tau_s = 1",
                                             "channel.prr = 0.5, controller.tau_s = 1.5",
                                             "channel.prr = 0.5, controller.tau_s = 2"));
  EXPECT_DOUBLE_EQ(experiment.arms[4].scenario.get<ControllerSettings>().tau_s, 1.5);
  EXPECT_DOUBLE_EQ(experiment.arms[4].scenario.get<ChannelSettings>().uplink.fixed.prr, 0.5);
  EXPECT_DOUBLE_EQ(experiment.arms[4].scenario.get<ChannelSettings>().downlink.fixed.prr, 0.5);
}

TEST_F(ExperimentFile, ZippedKeysGoTogether) {
  const Experiment experiment = load(R"(
seeds = 1
[[zip]]
"channel.uplink.prr" = [0.2, 0.4]
"channel.downlink.prr" = [0.4, 0.2]
)");
  EXPECT_THAT(texts(experiment),
              ElementsAre("channel.uplink.prr = 0.2, channel.downlink.prr = 0.4",
                          "channel.uplink.prr = 0.4, channel.downlink.prr = 0.2"));
}

TEST_F(ExperimentFile, ZipsAndGridVaryInTheOrderOfTheFile) {
  const Experiment experiment = load(R"(
seeds = 1
[[zip]]
channel.uplink.prr = [0.2, 0.4]
channel.downlink.prr = [0.4, 0.2]
[grid]
controller.tau_s = [1, 2]
)");
  EXPECT_THAT(experiment.keys,
              ElementsAre("channel.uplink.prr", "channel.downlink.prr", "controller.tau_s"));
  EXPECT_EQ(experiment.arms[1].text(),
            "channel.uplink.prr = 0.2, channel.downlink.prr = 0.4, controller.tau_s = 2");
}

TEST_F(ExperimentFile, ShowsTextsWithoutTheirQuotes) {
  const Experiment experiment = load(R"(
seeds = 1
[grid]
vehicle.plant = ["ode", "kinematic"]
)");
  EXPECT_THAT(texts(experiment), ElementsAre("vehicle.plant = ode", "vehicle.plant = kinematic"));
}

TEST_F(ExperimentFile, SeedsOfTheirOwnMustFitIn63Bits) {
  EXPECT_THAT(why_refused(R"(
seeds = [9000000000000000000]
common_random_numbers = false
[grid]
channel.prr = [0.2, 0.4]
)"),
              HasSubstr("seeds must be below 4611686018427387903"));
}

TEST_F(ExperimentFile, StepsOfARangeAreRoundNumbers) {
  const Experiment experiment = load(R"(
seeds = 1
[grid]
channel.prr = { from = 0, to = 1, step = 0.1 }
)");
  ASSERT_THAT(experiment.arms, SizeIs(11));
  EXPECT_EQ(experiment.arms[3].text(), "channel.prr = 0.3");
  EXPECT_EQ(experiment.arms[10].text(), "channel.prr = 1");
}

TEST_F(ExperimentFile, ARangeMayGoDownAndMayBeCounted) {
  const Experiment experiment = load(R"(
seeds = 1
[grid]
channel.delay_ms = { from = 500, to = 0, count = 3 }
)");
  EXPECT_THAT(texts(experiment), ElementsAre("channel.delay_ms = 500", "channel.delay_ms = 250",
                                             "channel.delay_ms = 0"));
}

TEST_F(ExperimentFile, SettingsApplyToAllArmsAndTheCommandLineToThem) {
  const Experiment experiment = load(R"(
seeds = 1
[set]
controller.tau_s = 3.0
run.duration_s = 10.0
)",
                                     {"run.duration_s=5"});
  ASSERT_THAT(experiment.arms, SizeIs(1));
  EXPECT_EQ(experiment.arms[0].text(), "all runs");
  EXPECT_DOUBLE_EQ(experiment.arms[0].scenario.get<ControllerSettings>().tau_s, 3.0);
  EXPECT_DOUBLE_EQ(experiment.arms[0].scenario.get<RunSettings>().duration_s, 5.0);
}

TEST_F(ExperimentFile, AModelAndItsParametersMayComeFromDifferentPlaces) {
  const Experiment experiment = load(R"(
seeds = 1
[set]
channel.downlink.model = "gilbert_elliott"
channel.downlink.gilbert_elliott.r = 0.5
[grid]
"channel.downlink.gilbert_elliott.p" = [0.01, 0.1]
)");
  EXPECT_THAT(experiment.arms, SizeIs(2));
}

TEST_F(ExperimentFile, SeedsAreANumberOfThemOrARangeOrAList) {
  const std::string grid = "[grid]\nchannel.prr = [1, 0.5]\n";
  EXPECT_THAT(load("seeds = 3\n" + grid).seeds, ElementsAre(1, 2, 3));
  EXPECT_THAT(load("seeds = { first = 7, last = 9 }\n" + grid).seeds, ElementsAre(7, 8, 9));
  EXPECT_THAT(load("seeds = { first = 0, last = 0 }\n" + grid).seeds, ElementsAre(0));
  EXPECT_THAT(load("seeds = [7, 3]\n" + grid).seeds, ElementsAre(7, 3));
}

TEST_F(ExperimentFile, ArmsShareTheirSeeds) {
  const Experiment experiment = load("seeds = [7, 3]\n[grid]\nchannel.prr = [1, 0.5]\n");
  for (const std::size_t arm : {0U, 1U}) {
    EXPECT_EQ(experiment.seed(arm, 0), 7U);
    EXPECT_EQ(experiment.seed(arm, 1), 3U);
    EXPECT_EQ(experiment.number(arm, 3), 1U);
    EXPECT_EQ(experiment.number(arm, 4), std::nullopt);
  }
}

TEST_F(ExperimentFile, ArmsHaveSeedsOfTheirOwnOnRequest) {
  const Experiment experiment =
      load("seeds = 3\ncommon_random_numbers = false\n[grid]\nchannel.prr = [1, 0.5]\n");
  std::set<std::uint64_t> seeds;
  for (const std::size_t arm : {0U, 1U}) {
    for (const std::size_t n : {0U, 1U, 2U}) {
      seeds.insert(experiment.seed(arm, n));
      EXPECT_EQ(experiment.number(arm, experiment.seed(arm, n)), n);
    }
  }
  EXPECT_THAT(seeds, SizeIs(6));
}

TEST_F(ExperimentFile, PrecisionTakesThePlaceOfSeeds) {
  const Experiment experiment = load(R"(
[precision]
metric = "rmse_m"
half_width = 0.5
most_seeds = 200
)");
  ASSERT_TRUE(experiment.precision);
  EXPECT_EQ(experiment.precision->metric, "rmse_m");
  EXPECT_EQ(experiment.precision->batch, 20U);
  EXPECT_THAT(experiment.seeds, SizeIs(200));
}

TEST_F(ExperimentFile, NamesEachMetricAsTheTableDoes) {
  for (std::size_t i = 0; i < metrics().size(); ++i) {
    const std::string& name = metrics()[i].name;
    EXPECT_EQ(metric_number(name), i) << "unlike all others' names";
    const Experiment experiment =
        load(fmt::format("[precision]\nmetric = \"{}\"\nhalf_width = 1\nmost_seeds = 50\n", name));
    EXPECT_EQ(experiment.precision->metric, name);
  }
}

struct BadFile {
  const char* name;
  const char* text;
  std::vector<std::string> says;
};

class BadExperimentFile : public ExperimentFile, public ::testing::WithParamInterface<BadFile> {};

TEST_P(BadExperimentFile, IsRefusedWithPlaceAndReason) {
  const std::string why = why_refused(GetParam().text);
  for (const std::string& part : GetParam().says) EXPECT_THAT(why, HasSubstr(part));
}

INSTANTIATE_TEST_SUITE_P(
    All, BadExperimentFile,
    ::testing::Values(
        BadFile{"NoSeeds", "", {"seeds must be given"}},
        BadFile{"ZeroSeeds", "seeds = 0", {"e.toml:2", "seeds", "from 1"}},
        BadFile{"NegativeSeed", "seeds = [1, -1]", {"e.toml:2", "from 0 on"}},
        BadFile{
            "SeedsWithoutAnEnd", "seeds = { first = 1 }", {"e.toml:2", "seeds.last must be given"}},
        BadFile{"SeedsThatEndBeforeTheFirst",
                "seeds = { first = 5, last = 4 }",
                {"e.toml:2", "seeds.last", "from 5"}},
        BadFile{"SeedsWithAnUnknownKey", "seeds = { frist = 1 }", {"e.toml:2", "frist"}},
        BadFile{"SeedTwice", "seeds = [1, 1]", {"each once"}},
        BadFile{"EmptyListOfSeeds", "seeds = []", {"one seed or more"}},
        BadFile{"UnknownKey", "seeds = 1\nseed = 4", {"e.toml:3", "\"seed\"", "allowed:"}},
        BadFile{"UnknownGridKey",
                "seeds = 1\n[grid]\nchannel.pr = [1]",
                {"e.toml:4", "channel.pr", "did you mean"}},
        BadFile{"ValueOutOfRange",
                "seeds = 1\n[grid]\nchannel.prr = [0.5, 1.5]",
                {"e.toml:4", "channel.uplink.prr = 1.5", "[0, 1]"}},
        BadFile{"EmptyGrid", "seeds = 1\n[grid]", {"e.toml:3", "[grid]"}},
        BadFile{
            "EmptyList", "seeds = 1\n[grid]\nchannel.prr = []", {"e.toml:4", "one value or more"}},
        BadFile{"NoList", "seeds = 1\n[grid]\nchannel.prr = 0.5", {"e.toml:4", "must be a list"}},
        BadFile{"RangeWithoutEnd",
                "seeds = 1\n[grid]\nchannel.prr = { from = 0, step = 0.1 }",
                {"e.toml:4", "from, to, step"}},
        BadFile{"RangeTheWrongWay",
                "seeds = 1\n[grid]\nchannel.prr = { from = 1, to = 0, step = 0.1 }",
                {"e.toml:4", "from, to, step"}},
        BadFile{"RangeWithStepZero",
                "seeds = 1\n[grid]\nchannel.prr = { from = 0, to = 1, step = 0 }",
                {"e.toml:4", "from, to, step"}},
        BadFile{"ValueTwice",
                "seeds = 1\n[grid]\nchannel.prr = [0.5, 0.50]",
                {"e.toml:4", "channel.prr = 0.5 is there twice"}},
        BadFile{"KeyTwice",
                "seeds = 1\n[grid]\nchannel.prr = [1]\n\"channel.uplink.prr\" = [0.5]",
                {"e.toml:5", "channel.uplink.prr is varied twice", "channel.prr"}},
        BadFile{"ZipsOfDifferentLength",
                "seeds = 1\n[[zip]]\n\"channel.prr\" = [1, 0.5]\n\"controller.tau_s\" = [1]",
                {"e.toml:5", "has 1 values", "channel.prr", "has 2"}},
        BadFile{"ZipAgainstGrid",
                "seeds = 1\n[grid]\nchannel.prr = [1]\n[[zip]]\n\"channel.prr\" = [0.5]",
                {"e.toml:5", "varied twice"}},
        BadFile{"ZipIsNoList", "seeds = 1\n[zip]\nchannel.prr = [1]", {"e.toml:3", "[[zip]]"}},
        BadFile{"SetAgainstGrid",
                "seeds = 1\n[set]\nchannel.uplink.prr = 1\n[grid]\n\"channel.prr\" = [0.5]",
                {"e.toml:4", "varied by the grid", "e.toml:6"}},
        BadFile{"SeedInTheGrid", "seeds = 1\n[grid]\nrun.seed = [1, 2]", {"e.toml:4", "use seeds"}},
        BadFile{"SeedSet", "seeds = 1\n[set]\nrun.seed = 2", {"e.toml:4", "use seeds"}},
        BadFile{"KeyWithoutEffect",
                "seeds = 1\n[grid]\n\"channel.downlink.gilbert_elliott.p\" = [0.1]",
                {"has no effect"}},
        BadFile{"PrecisionAndSeeds",
                "seeds = 5\n[precision]\nhalf_width = 1\nmost_seeds = 50",
                {"e.toml:2", "left out"}},
        BadFile{"PrecisionWithoutLimit",
                "[precision]\nhalf_width = 1",
                {"e.toml:2", "most_seeds must be given"}},
        BadFile{
            "PrecisionWithoutWidth", "[precision]\nmost_seeds = 20", {"half_width must be given"}},
        BadFile{"FewerSeedsThanABatch",
                "[precision]\nhalf_width = 1\nmost_seeds = 5",
                {"e.toml:4", "from 20"}},
        BadFile{"UnknownMetric",
                "[precision]\nmetric = \"eps\"\nhalf_width = 1\nmost_seeds = 50",
                {"e.toml:3", "epsilon_m, rmse_m"}},
        BadFile{"UnknownFigure", "seeds = 1\n[figure]\nkind = \"pie\"", {"e.toml:4", "heatmap"}},
        BadFile{"FigureOfAKeyThatDoesNotVary",
                "seeds = 1\n[grid]\nchannel.prr = [1]\n[figure]\nx = \"controller.tau_s\"",
                {"e.toml:6", "channel.prr"}},
        BadFile{"FigureThatMixesValues",
                "seeds = 1\n[grid]\nchannel.prr = [1]\n\"controller.tau_s\" = [1, 2]\n"
                "[figure]\nx = \"channel.prr\"",
                {"[figure]", "controller.tau_s varies too"}},
        BadFile{"RiskMapWithoutTrajectories",
                "seeds = 1\n[figure]\nkind = \"risk_map\"",
                {"[figure]", "trajectory_period_s"}},
        BadFile{"ComparisonOverTexts",
                "seeds = 1\n[grid]\nvehicle.plant = [\"ode\", \"kinematic\"]\n"
                "channel.prr = [1]\n[figure]\nkind = \"comparison\"\nx = \"vehicle.plant\"\n"
                "y = \"channel.prr\"",
                {"[figure]", "is no number"}},
        BadFile{"ExpressionOfNoMetric",
                "seeds = 1\n[grid]\nchannel.prr = [1]\n[figure]\nx = \"channel.prr\"\n"
                "metric = \"epsilon_m / speed\"",
                {"e.toml:7", "figure.metric must be one of epsilon_m, rmse_m", "\"speed\""}},
        BadFile{"ExpressionThatEndsEarly",
                "seeds = 1\n[grid]\nchannel.prr = [1]\n[figure]\nx = \"channel.prr\"\n"
                "metric = \"max(epsilon_m, 2\"",
                {"e.toml:7", "expression over them"}},
        BadFile{"PrecisionOfAnExpression",
                "[precision]\nmetric = \"2 * epsilon_m\"\nhalf_width = 1\nmost_seeds = 50",
                {"e.toml:3", "epsilon_m, rmse_m"}},
        BadFile{"CurveOfTooManySeries",
                "seeds = 1\n[grid]\nchannel.prr = [1]\n"
                "\"controller.tau_s\" = [1, 2, 3, 4, 5, 6, 7, 8]\n"
                "[figure]\nx = \"channel.prr\"\ny = \"controller.tau_s\"",
                {"[figure]", "at most 7 series"}},
        BadFile{"NameThatIsAPath", "seeds = 1\nname = \"../../else\"", {"e.toml:3", "letters"}},
        BadFile{"QuickSeedsWithAPrecision",
                "quick_seeds = 1\n[precision]\nhalf_width = 0.1\nmost_seeds = 100",
                {"e.toml:2", "quick_seeds must be left out"}},
        BadFile{"RowsWithoutEnd", "seeds = 1\ntrajectory_period_s = 1e-7", {"e.toml:3", "[0.01"}},
        BadFile{"NoToml", "seeds = = 1", {"e.toml:2"}}),
    [](const auto& info) { return std::string(info.param.name); });

TEST_F(ExperimentFile, WithoutScenarioIsRefused) {
  write_file(file_, "seeds = 1\n");
  EXPECT_THROW(load_experiment(file_), UsageError);
}

TEST_F(ExperimentFile, ThatIsNotThereOrMayNeverEndIsNamed) {
  EXPECT_THAT([] { load_experiment("/no/such.toml"); },
              ::testing::ThrowsMessage<UsageError>(
                  HasSubstr("the experiment file \"/no/such.toml\": No such file")));
  EXPECT_THAT([] { load_experiment("/dev/zero"); },
              ::testing::ThrowsMessage<UsageError>(HasSubstr("it is not a regular file")));
}

TEST_F(ExperimentFile, TheCommandLineMayNotSetWhatTheGridVaries) {
  EXPECT_THAT(why_refused("seeds = 1\n[grid]\nchannel.prr = [1]\n", {"channel.downlink.prr=0.5"}),
              AllOf(HasSubstr("--set channel.downlink.prr=0.5"), HasSubstr("e.toml:4")));
}

}  // namespace
}  // namespace tether
