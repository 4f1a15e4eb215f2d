#include "tools/experiment/sweep/tune.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "common/base/errors.hpp"
#include "controller/laws/controller_settings.hpp"
#include "netem/channel/settings.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/tools/runs/run_files.hpp"
#include "tools/base/replacing_output.hpp"

namespace tether {
namespace {

using ::testing::DoubleEq;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr char kHead[] = R"(seeds = [301, 302]
evaluations = 8
rounds = 3
[set]
run.duration_s = 10.0
vehicle.plant = "kinematic"
[condition."PRR 1"]
[condition."PRR 0.7"]
channel.prr = 0.7
)";
constexpr char kBounds[] = R"([bounds.pid]
controller.tau_s = { from = 0.5, to = 5.0, scale = "log" }
controller.omega.p = { from = 0.1, to = 2.0 }
)";
constexpr char kLaws[] = R"([law."PID, 5 Hz"]
bounds = "pid"
sensor.rate_hz = 5.0
[law."on board"]
bounds = "pid"
conditions = ["PRR 1"]
sensor.rate_hz = 20.0
)";

class Tune : public ::testing::Test {
 protected:
  Tuning load(const std::string& text, const std::vector<std::string>& overrides = {},
              bool quick = false) {
    const std::string file = (folder_ / "tune.toml").string();
    write_file(file,
               fmt::format("scenario = \"{}/scenarios/paper.toml\"\n{}", in_source(""), text));
    return load_tuning(file, overrides, quick);
  }
  Tuning load() { return load(std::string(kHead) + kBounds + kLaws); }
  std::string why_refused(const std::string& text) {
    try {
      load(text);
    } catch (const UsageError& error) {
      return error.what();
    }
    return "not refused";
  }

  std::optional<Gains> tuned(const Tuning& tuning, const std::string& folder, std::size_t jobs = 1,
                             const std::vector<std::string>& laws = {},
                             const std::string& kept = {}) {
    const auto result = all_of(tuning, folder, jobs, laws, kept);
    if (!result) return std::nullopt;
    return result->gains.front();
  }
  std::optional<TuneResult> all_of(const Tuning& tuning, const std::string& folder,
                                   std::size_t jobs = 1, const std::vector<std::string>& laws = {},
                                   const std::string& kept = {}) {
    return tune(tuning, chosen(tuning, laws, kept), folder_ / folder, jobs,
                "tether tune tune.toml");
  }

  test::Folder own_;
  const std::filesystem::path& folder_ = own_.path;
};

TEST_F(Tune, AFileHasLawsConditionsAndBounds) {
  const Tuning tuning = load();
  EXPECT_EQ(tuning.name, "tune");
  EXPECT_THAT(tuning.conditions, SizeIs(2));
  ASSERT_THAT(tuning.laws, SizeIs(2));
  EXPECT_THAT(tuning.laws[0].conditions, ElementsAre(0, 1));
  EXPECT_THAT(tuning.laws[1].conditions, ElementsAre(0));
  EXPECT_THAT(tuning.laws[0].given, ElementsAre(ElementsAre(2.0, 0.2925))) << "of the scenario";
  const Scenario scenario = tuning.scenario_of(tuning.laws[0], 1, {3.0, 0.5});
  EXPECT_EQ(scenario.get<ControllerSettings>().tau_s, 3.0);
  EXPECT_EQ(scenario.get<ControllerSettings>().omega.p, 0.5);
  EXPECT_EQ(scenario.get<ChannelSettings>().uplink.fixed.prr, 0.7);
}

TEST_F(Tune, QuickHasFewerSeedsAndCandidates) {
  const std::string text =
      "quick_seeds = 1\nquick_evaluations = 4\n" + std::string(kHead) + kBounds;
  EXPECT_THAT(load(text + kLaws).laws[0].seeds, SizeIs(2));
  const TuningLaw quick = load("searches = 3\n" + text + kLaws, {}, true).laws[0];
  EXPECT_THAT(quick.seeds, SizeIs(1));
  EXPECT_EQ(quick.searches, 1U);
  EXPECT_EQ(quick.budget.evaluations, 4U);
  EXPECT_EQ(quick.budget.rounds, 2U) << "two candidates in each at least";
}

TEST_F(Tune, ALawMayHaveAnEffortOfItsOwn) {
  const std::string costly = "[law.costly]\nbounds = \"pid\"\nevaluations = 4\nfirst_seeds = 1\n";
  const Tuning tuning = load(std::string(kHead) + kBounds + kLaws + costly);
  EXPECT_THAT(tuning.laws[0].seeds, ElementsAre(301, 302));
  EXPECT_EQ(tuning.laws[0].budget.evaluations, 8U);
  EXPECT_THAT(tuning.laws[2].seeds, ElementsAre(301));
  EXPECT_EQ(tuning.laws[2].budget.evaluations, 4U);
  EXPECT_EQ(tuning.laws[2].budget.rounds, 2U);
}

TEST_F(Tune, AllSearchesMayBeginAtTheCentreOfTheBounds) {
  const Tuning tuning = load("start = \"centre\"\n" + std::string(kHead) + kBounds + kLaws);
  EXPECT_THAT(tuning.laws[0].given, ElementsAre(ElementsAre(1.58, 1.05)))
      << "sqrt(0.5 * 5), (0.1 + 2) / 2";
}

TEST_F(Tune, WhatIsKnownIsTriedToo) {
  const std::string bounds = R"([bounds.pid]
controller.tau_s = { from = 0.5, to = 5.0, known = [2.0, 1.0] }
controller.omega.p = { from = 0.1, to = 2.0, known = [0.29, 1.234567] }
)";
  const Tuning tuning = load("start = \"centre\"\n" + std::string(kHead) + bounds + kLaws);
  EXPECT_THAT(tuning.laws[0].given, ElementsAre(ElementsAre(2.75, 1.05), ElementsAre(2.0, 0.29),
                                                ElementsAre(1.0, 1.234567)));
}

TEST_F(Tune, WhatIsWrongIsRefusedWithItsPlace) {
  const auto bounds = [this](const std::string& key) {
    return why_refused(std::string(kHead) + "[bounds.pid]\n" + key + "\n" + kLaws);
  };
  EXPECT_THAT(
      bounds("controller.tau_s = { from = 2.0, to = 1.0 }"),
      HasSubstr("tune.toml:12: controller.tau_s = { from = 2, to = 1 }: from must be below to"));
  EXPECT_THAT(bounds("controller.tau_s = { from = 1.0, to = 1.0 }"),
              HasSubstr("controller.tau_s = { from = 1, to = 1 }: from must be below to"));
  EXPECT_THAT(bounds("controller.tau_s = { from = 0.0, to = 1.0, scale = \"log\" }"),
              HasSubstr("controller.tau_s.from must be positive where scale is \"log\""));
  EXPECT_THAT(bounds("controller.tau_s = { from = 0.1, to = 1.0, scale = \"ln\" }"),
              HasSubstr("\"linear\" or \"log\""));
  EXPECT_THAT(bounds("controller.tau_s = { from = -1.0, to = 1.0 }"),
              HasSubstr("tune.toml:12: controller.tau_s = -1.0 is not allowed"))
      << "the scenario's own range";
  EXPECT_THAT(bounds("controller.tau = { from = 0.1, to = 1.0 }"),
              HasSubstr("tune.toml:12: controller.tau must be a scenario key"));
  EXPECT_THAT(bounds("controller.law = { from = 0.1, to = 1.0 }"),
              HasSubstr("a scenario key whose value is a number"));
  EXPECT_THAT(
      bounds("controller.tracking.k_x = { from = 0.1, to = 1.0 }"),
      HasSubstr("tune.toml:12: controller.tracking.k_x has no effect on law \"PID, 5 Hz\""));
  EXPECT_THAT(bounds("controller.tau_s = { from = 1.0, to = 2.0, known = [3.0] }"),
              HasSubstr("tune.toml:12: controller.tau_s.known must be a list of numbers within"));
  EXPECT_THAT(bounds("controller.tau_s = { from = 1.0, to = 2.0, known = [1.5] }\n"
                     "controller.v.p = { from = 1.0, to = 2.0 }"),
              HasSubstr("tune.toml:13: controller.v.p.known must have as many values as"));
  const std::string all = std::string(kHead) + kBounds + kLaws;
  EXPECT_THAT(why_refused("seed = 3\n" + all), HasSubstr("tune.toml:2: unknown key \"seed\""));
  EXPECT_THAT(why_refused("start = \"here\"\n" + all),
              HasSubstr("start must be \"scenario\" or \"centre\""));
  EXPECT_THAT(why_refused(all + "[law.x]\nbounds = \"pid\"\nevaluations = 1\n"),
              HasSubstr("tune.toml:23: law.\"x\".evaluations must be a whole number from 2 "));
  EXPECT_THAT(why_refused("metric = \"speed\"\n" + all), HasSubstr("metric must be one of"));
  EXPECT_THAT(why_refused(all + "[law.x]\nbounds = \"lqr\"\n"),
              HasSubstr("law.\"x\".bounds must be given, one of \"pid\""));
  EXPECT_THAT(why_refused(all + "[law.x]\nbounds = \"pid\"\nconditions = [\"calm\"]\n"),
              HasSubstr("conditions must be a list of \"PRR 1\", \"PRR 0.7\""));
  EXPECT_THAT(why_refused(all + "[law.x]\nbounds = \"pid\"\nrun.seed = 3\n"),
              HasSubstr("use seeds"));
  EXPECT_THAT(why_refused(std::string(kHead) + kBounds), HasSubstr("law must be given"));
}

TEST_F(Tune, ValuesHaveThreeDigitsAndStayWithinTheirBounds) {
  const TunedKey log{"k", 0.0123, 45.678, true, {}, {}, ""};
  const TunedKey linear{"k", -1.0, 3.0, false, {}, {}, ""};
  for (const TunedKey& key : {log, linear}) {
    EXPECT_EQ(key.at(0.0), key.from);
    EXPECT_EQ(key.coordinate_of(key.from), 0.0);
    EXPECT_NEAR(key.coordinate_of(key.at(0.3)), 0.3, 1e-3);
    EXPECT_LE(key.at(1.0), key.to);
    EXPECT_GE(key.coordinate_of(1000.0), 1.0 - 1e-12);
  }
  EXPECT_EQ(number_text(log.at(0.5)), "0.75");  // sqrt(0.0123 * 45.678) = 0.7496
  EXPECT_EQ(number_text(linear.at(0.123)), "-0.508");
}

TEST_F(Tune, ALostVehicleCountsAsTheMostAndAConditionByItsFactor) {
  constexpr TunedRun kFailed{std::numeric_limits<double>::quiet_NaN(), true};
  const std::vector<std::vector<TunedRun>> runs{{{0.1, false}, {0.3, false}},
                                                {{25.0, true}, {10.0, false}, kFailed}};
  const Worth worth = worth_of({10.0, true}, runs);
  EXPECT_THAT(worth.means, ElementsAre(DoubleEq(0.2), DoubleEq(10.0)));
  EXPECT_NEAR(worth.error, std::sqrt(0.2 * 10.0), 1e-12);
  EXPECT_EQ(worth.objective(Aim::error), worth.error);
  EXPECT_NEAR(worth_of({10.0, false}, {runs[0], {{25.0, true}, {10.0, true}}}).error, 5.1, 1e-12);
  const WorthRule no_limit{std::numeric_limits<double>::infinity(), false};
  EXPECT_TRUE(std::isinf(worth_of(no_limit, {{kFailed, {1.0, false}}}).error));
}

TEST_F(Tune, OneLostVehicleMoreIsWorseForSurvivalThanAnyErrorOfTheOthers) {
  const WorthRule rule{10.0, true};
  const Worth far_off =
      worth_of(rule, {{{9.9, false}, {9.9, false}}, {{9.9, false}, {9.9, false}}});
  const Worth one_lost =
      worth_of(rule, {{{0.01, false}, {30.0, true}}, {{0.04, false}, {0.04, false}}});
  EXPECT_LT(far_off.objective(Aim::survival), one_lost.objective(Aim::survival));
  EXPECT_GT(far_off.objective(Aim::error), one_lost.objective(Aim::error));
  EXPECT_THAT(one_lost.lost_by_condition, ElementsAre(1, 0));
  EXPECT_EQ(one_lost.n, 4U);
  EXPECT_NEAR(one_lost.survivors_error, 0.02, 1e-12);
  const Worth as_many =
      worth_of(rule, {{{0.02, false}, {30.0, true}}, {{0.04, false}, {0.04, false}}});
  EXPECT_LT(one_lost.objective(Aim::survival), as_many.objective(Aim::survival));
  EXPECT_NEAR(worth_of(rule, {{{30.0, true}}, {{0.1, false}}}).survivors_error, 1.0, 1e-12)
      << "a condition without survivors counts as the most: sqrt(10 * 0.1)";
  const WorthRule no_limit{std::numeric_limits<double>::infinity(), false};
  EXPECT_EQ(worth_of(no_limit, {{{30.0, true}}}).objective(Aim::survival), 2.0);
}

constexpr char kChoices[] = R"([bounds.pid]
controller.tau_s = { from = 0.5, to = 5.0, scale = "log" }
controller.trigger = { choices = ["event", "timer"] }
actuator.policy = { choices = ["hold", "ramp"] }
actuator.timeout_s = { from = 0.2, to = 2.0 }
[law."PID"]
bounds = "pid"
controller.rate_hz = 7.0
sensor.rate_hz = 20.0
)";

TEST_F(Tune, AKeyMayHaveChoicesAndWhatTheScenarioRefusesIsLeftOut) {
  const Tuning tuning = load(std::string(kHead) + kChoices);
  const TuningLaw& law = tuning.laws[0];
  const TunedKey& trigger = law.keys[1];
  EXPECT_EQ(trigger.text(trigger.at(0.49)), "'event'");
  EXPECT_EQ(trigger.text(trigger.at(0.5)), "'timer'");
  EXPECT_EQ(trigger.at(1.0), 1.0);
  EXPECT_EQ(trigger.at(trigger.coordinate_of(1.0)), 1.0);
  EXPECT_THAT(law.given, ElementsAre(ElementsAre(2.0, 0.0, 0.0, 0.5))) << "of the scenario";
  const auto keys = [&](double of_trigger, double of_policy) {
    std::vector<std::string> names;
    const auto chosen = tuning.chosen(law, {2.0, of_trigger, of_policy, 0.7});
    for (const auto& given : chosen.settings) names.push_back(given.setting.key);
    for (const auto& given : chosen.gains) names.push_back(given.setting.key);
    return names;
  };
  EXPECT_THAT(keys(1, 1),
              ElementsAre("controller.rate_hz", "sensor.rate_hz", "controller.tau_s",
                          "controller.trigger", "actuator.policy", "actuator.timeout_s"));
  const auto untuned = tuning.chosen(law, {}).settings;
  ASSERT_THAT(untuned, SizeIs(1)) << "the scenario answers poses: rate_hz would be refused";
  EXPECT_EQ(untuned[0].setting.key, "sensor.rate_hz");
  const auto settings = tuning.scenario_of(law, 0, {2.0, 1.0, 0.0, 0.7}).get<ControllerSettings>();
  EXPECT_EQ(settings.trigger, ControllerSettings::Trigger::timer);
  EXPECT_EQ(settings.rate_hz, 7.0);
}

TEST_F(Tune, ChoicesThatAreWrongAreRefused) {
  const auto why = [this](const std::string& line, const std::string& law = "") {
    return why_refused(std::string(kHead) + "[bounds.pid]\n" + line +
                       "\n[law.PID]\nbounds = \"pid\"\n" + law);
  };
  EXPECT_THAT(why("controller.trigger = { choices = [\"event\"] }"),
              HasSubstr("controller.trigger.choices must be a list of at least two different"));
  EXPECT_THAT(why("controller.trigger = { choices = [\"event\", \"event\"] }"),
              HasSubstr("a list of at least two different"));
  EXPECT_THAT(why("controller.trigger = { choices = [\"event\", \"never\"] }"),
              HasSubstr("controller.trigger = 'never' is not allowed"));
  EXPECT_THAT(why("controller.trigger = { choices = [\"event\", \"timer\"], known = [\"x\"] }"),
              HasSubstr("controller.trigger.known must be a list of choices"));
  EXPECT_THAT(why("actuator.policy = { choices = [\"zero\", \"ramp\"] }"),
              HasSubstr("actuator.policy.choices must have \"hold\", from which tuning starts"));
  EXPECT_THAT(why("actuator.policy = { choices = [\"hold\", \"zero\"] }\n"
                  "controller.rate_hz = { from = 5.0, to = 10.0 }",
                  "sensor.rate_hz = 20.0\n"),
              HasSubstr("controller.rate_hz has no effect on law \"PID\""));
  EXPECT_THAT(why_refused("aims = [\"speed\"]\n" + std::string(kHead) + kChoices),
              HasSubstr("aims must be a list of \"error\" and \"survival\""));
  EXPECT_THAT(why_refused(std::string(kHead) + kChoices + "[front]\nseeds = [302, 400]\n"),
              HasSubstr("front.seeds must be others than the tuning's, of which 302 is one"));
}

TEST_F(Tune, SurvivalHasSearchesAndGainsOfItsOwnAndAFrontWithFreshSeeds) {
  const std::string lossy =
      "seeds = [301, 302, 303]\nevaluations = 8\nrounds = 2\naims = [\"error\", "
      "\"survival\"]\nmost = 10.0\n"
      "[front]\nseeds = { first = 401, last = 406 }\n"
      "[set]\nrun.duration_s = 30.0\nvehicle.plant = \"kinematic\"\n"
      "[condition.\"PRR 0.7\"]\nchannel.prr = 0.7\n[condition.\"PRR 0.3\"]\nchannel.prr = 0.3\n";
  const auto result = all_of(load(lossy + kChoices), "both", 2);
  ASSERT_TRUE(result);
  ASSERT_THAT(result->gains, SizeIs(2));
  EXPECT_THAT(result->gains[1].objective, HasSubstr("lost vehicles + e/(1 + e)"));
  // Nothing that was tried for the error has fewer lost runs than what survival found.
  ASSERT_THAT(result->gains[1].laws, SizeIs(1));
  ASSERT_FALSE(result->front.empty());
  bool is_any_on_front = false;
  for (const FrontPoint& point : result->front) {
    EXPECT_EQ(point.lost.n, 12U);
    EXPECT_EQ(point.law, "PID");
    EXPECT_TRUE(contains(point.lost.interval, point.lost.value));
    is_any_on_front |= point.is_on_front;
  }
  EXPECT_TRUE(is_any_on_front);
  const std::string file = (folder_ / "survival.toml").string();
  write_file(file, to_toml(result->gains[1]));
  const TunedLaw law = read_gains(file).laws.at(0);
  EXPECT_EQ(law.after, result->gains[1].laws[0].after);
  EXPECT_EQ(law.means_after, result->gains[1].laws[0].means_after);
  ASSERT_EQ(law.gains.size(), result->gains[1].laws[0].gains.size());
  EXPECT_EQ(law.gains[1], result->gains[1].laws[0].gains[1]) << "the trigger, a text";
}

TEST_F(Tune, FindsBetterGainsOfARealLoop) {
  const auto gains = tuned(load(), "out");
  ASSERT_TRUE(gains);
  ASSERT_THAT(gains->laws, SizeIs(2));
  for (const TunedLaw& law : gains->laws) {
    EXPECT_THAT(law.seeds, ElementsAre(301, 302));
    EXPECT_THAT(law.found, ElementsAre(law.after));
    // The paper's gains at 20 Hz are off by some 1.7 m; the best of eight by less than half of it.
    EXPECT_LT(law.after, 0.7 * law.before) << law.name;
    ASSERT_THAT(law.gains, SizeIs(2));
    EXPECT_EQ(law.gains[0].key, "controller.tau_s");
  }
  EXPECT_THAT(gains->laws[0].means_after, SizeIs(2));
  EXPECT_THAT(gains->laws[1].conditions, ElementsAre("PRR 1"));
}

TEST_F(Tune, WhatIsWrittenReadsAsTheSame) {
  Gains gains = tuned(load(), "out").value();
  gains.file = (folder_ / "gains.toml").string();
  write_file(gains.file, to_toml(gains));
  EXPECT_EQ(read_gains(gains.file), gains);
}

TEST_F(Tune, GivesTheSameGainsWithAnyNumberOfThreadsAndWhenItGoesOn) {
  const auto text = [this](const std::string& folder, std::size_t jobs) {
    return to_toml(tuned(load(), folder, jobs).value());
  };
  const std::string one = text("one", 1);
  EXPECT_EQ(text("three", 3), one);
  std::filesystem::remove_all(folder_ / "three" / "PID-5-Hz" / "round3");
  EXPECT_EQ(text("three", 2), one) << "two rounds were there";
}

TEST_F(Tune, TheBestOfAllSearchesCounts) {
  const Gains gains =
      tuned(load("searches = 2\n" + std::string(kHead) + kBounds + kLaws), "two", 2, {"on board"})
          .value();
  ASSERT_THAT(gains.laws, SizeIs(1));
  const TunedLaw& law = gains.laws[0];
  ASSERT_THAT(law.found, SizeIs(2));
  EXPECT_NE(law.found[0], law.found[1]);
  EXPECT_EQ(law.after, std::min(law.found[0], law.found[1]));
  EXPECT_EQ(law.found[0], tuned(load(), "one", 2, {"on board"})->laws[0].after)
      << "the first is what one search finds";
}

TEST_F(Tune, LawsMayBeTunedOneByOne) {
  const Gains all = tuned(load(), "all").value();
  Gains some = tuned(load(), "some", 1, {"on board"}).value();
  EXPECT_THAT(some.laws, ElementsAre(all.laws[1]));
  const std::string file = (folder_ / "gains.toml").string();
  write_file(file, to_toml(all));
  EXPECT_EQ(tuned(load(), "kept", 1, {"on board"}, file), all);
}

TEST_F(Tune, LawsThatAreKeptMustHaveHadTheSameEffort) {
  const std::string file = (folder_ / "gains.toml").string();
  Gains gains;
  gains.objective = load().objective(Aim::error);
  const auto why = [&](const std::string& law) {
    try {
      chosen(load(), {law}, file);
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string("not refused");
  };
  gains.laws = tuned(load(), "out", 1, {"on board"})->laws;
  write_file(file, to_toml(gains));
  EXPECT_EQ(why("PID, 5 Hz"), "not refused");
  EXPECT_THAT(why("on board"), HasSubstr("law \"PID, 5 Hz\" of"));
  EXPECT_THAT(why("LQR"), HasSubstr("must be a law of"));
  gains.laws[0].evaluations = 7;
  write_file(file, to_toml(gains));
  EXPECT_THAT(why("PID, 5 Hz"), HasSubstr("law \"on board\" of"));
  gains.objective = "another";
  write_file(file, to_toml(gains));
  EXPECT_THAT(why("PID, 5 Hz"), HasSubstr("was tuned for another objective: another"));
}

}  // namespace
}  // namespace tether
