#include "doors/ros2/ros2_settings.hpp"

#include <fmt/format.h>

#include <string>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"

namespace tether {
namespace {

using Settings = Ros2Settings;

}  // namespace

ScenarioSection ros2_section() {
  KeyTable<Settings> t("ros2.");
  t.whole_number("domain", &Settings::domain, 0, "ROS 2's domain (ROS_DOMAIN_ID), at most 101");
  t.choice<Settings::Range>(
      "range", &Settings::range,
      {{"localhost", Settings::Range::localhost}, {"subnet", Settings::Range::subnet}},
      "hosts whose nodes are found: this one, or all that multicast reaches. DDS does not "
      "authenticate: any of them can send commands");
  t.boolean("sim_time", &Settings::sim_time,
            "stamps are the run's time, and /clock is published; false: Unix time. In simulated "
            "time always true");
  t.number("max_age_s", &Settings::max_age_s, kPositive,
           "maximum age of a TwistStamped at its arrival; an older one is refused");
  t.number("answer_patience_s", &Settings::answer_patience_s, {0.001, 60.0, false},
           "in simulated time: maximum wait for the answer to a pose, wall clock");
  ScenarioSection section{.defaults = Settings{}, .keys = t.take()};
  section.check = [](const Scenario& scenario, const std::string& file) {
    const int domain = scenario.get<Settings>().domain;
    constexpr int kMostDomain = 101;  // ports of greater ones are among the ephemeral ones
    if (domain <= kMostDomain) return;
    throw UsageError(
        fmt::format("{}: ros2.domain = {} must be 0 to {}", file, domain, kMostDomain));
  };
  return section;
}

}  // namespace tether
