#include <gmock/gmock.h>

#include <cmath>
#include <limits>

#include "common/base/errors.hpp"
#include "tools/runs/metric.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;

/// Value for a run with these metrics; all others are 0.
double value_of(const std::string& expression,
                const std::vector<std::pair<std::string, double>>& known) {
  std::vector<double> all(metrics().size());
  for (const auto& [name, value] : known) all[metric_number(name).value()] = value;
  return MetricExpression(expression).of(all);
}

std::string refusal(const std::string& expression) {
  try {
    MetricExpression{expression};
  } catch (const UsageError& refused) {
    return refused.what();
  }
  return "";
}

TEST(MetricExpression, OfANameIsThatMetric) {
  EXPECT_EQ(value_of("rmse_m", {{"epsilon_m", 1.0}, {"rmse_m", 2.0}}), 2.0);
  EXPECT_EQ(MetricExpression("epsilon_m").label(), "ε [m]");
  EXPECT_TRUE(MetricExpression("epsilon_m").is_error());
  EXPECT_TRUE(MetricExpression("autonomous").is_share());
}

TEST(MetricExpression, ComputesWithAllMetrics) {
  EXPECT_EQ(value_of("100 * uplink_lost / uplink_sent", {{"uplink_lost", 3}, {"uplink_sent", 60}}),
            5.0);
  EXPECT_EQ(value_of("max(epsilon_m, 2) - min(rmse_m, -1)", {{"epsilon_m", 1.5}, {"rmse_m", 4}}),
            3.0);
  EXPECT_EQ(value_of("sqrt(abs(epsilon_m - rmse_m))", {{"epsilon_m", 1}, {"rmse_m", 10}}), 3.0);
  EXPECT_EQ(value_of("-(epsilon_m + 1) * 2", {{"epsilon_m", 1.0}}), -4.0);
  const MetricExpression loss("uplink_lost / uplink_sent");
  EXPECT_EQ(loss.label(), "uplink_lost / uplink_sent");
  EXPECT_FALSE(loss.is_error() || loss.is_share());
  EXPECT_TRUE(MetricExpression("1000 * epsilon_m").is_error())
      << "so lost vehicles can be distinguished";
}

TEST(MetricExpression, IsUnknownWhereAMetricOfItIs) {
  const double unknown = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(std::isnan(value_of("max(epsilon_m, 1)", {{"epsilon_m", unknown}})));
  EXPECT_EQ(value_of("max(epsilon_m, 1)", {{"rmse_m", unknown}}), 1.0);
}

TEST(MetricExpression, RefusesWhatItDoesNotKnowAndSaysWhatItDoes) {
  EXPECT_THAT(refusal("epsilon"), HasSubstr("one of epsilon_m, rmse_m"));
  EXPECT_THAT(refusal("epsilon_m / speed"), HasSubstr("\"speed\""));
  EXPECT_THAT(refusal("uplink_lots / 2"), HasSubstr("(did you mean \"uplink_lost\"?)"));
  EXPECT_THAT(refusal("2 * (epsilon_m"), HasSubstr("parenthesis"));
  EXPECT_THAT(refusal("epsilon_m, rmse_m"), HasSubstr("one number"));
  EXPECT_THAT(refusal("1 + 1"), HasSubstr("there is none in it"));
  EXPECT_THAT(refusal(""), HasSubstr("one of epsilon_m"));
}

}  // namespace
}  // namespace tether
