#include "common/scenario/run_settings.hpp"

#include "common/scenario/key_table.hpp"

namespace tether {

ScenarioSection run_section() {
  using Run = RunSettings;
  KeyTable<Run> t("run.");
  t.number("duration_s", &Run::duration_s, kPositive, "length of the run");
  t.number("lead_s", &Run::lead_s, {0.0, 1e3, false},
           "time that the loop runs before the path starts; the vehicle stands");
  t.whole_number("seed", &Run::seed, 0, "seed of all random streams");
  t.number("truth_rate_hz", &Run::truth_rate_hz, kRate,
           "SIM/TRUTH messages and trajectory rows per second");
  t.number("report_period_s", &Run::report_period_s, {0.01, 1e6, false},
           "interval between link reports, and between counter reports");
  t.number("settled_from_s", &Run::settled_from_s, kNotNegative,
           "settled_epsilon_m and settled_max_error_m count from this time on");
  t.number("lost_beyond_m", &Run::lost_beyond_m, kPositive,
           "error above which, for lost_for_s without a break, the vehicle counts as lost");
  t.number("lost_for_s", &Run::lost_for_s, kNotNegative,
           "time that the error must stay above lost_beyond_m, without a break");
  return {.defaults = Run{}, .keys = t.take()};
}

}  // namespace tether
