#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "common/scenario/scenario.hpp"
#include "netem/fit/channel_watch.hpp"
#include "tools/runs/run_observer.hpp"

namespace tether {

/// How long a run in lockstep took, compared with its lower bound: one round trip for each grant.
struct LockstepCost {
  std::int64_t grants = 0;
  std::optional<double> round_trip_s = {};  ///< median of those measured during the run, if any
  double wall_time_s = 0.0;  ///< from the first grant to the last answer, while it was not held
};

/// Result of a run for its user, on the terminal, as JSON and in summary.json.
struct RunSummary {
  double wall_time_s = 0.0;
  double sim_time_s = 0.0;
  Instant end = kStart;   ///< end of metrics
  int node_restarts = 0;  ///< live runs: how often a node died and was started again
  /// Live runs: what makes it another run than it says, in words; empty if nothing does.
  std::optional<std::vector<std::string>> findings = {};
  std::optional<ChannelReport> channel = {};  ///< only for runs in one process
  std::optional<double> tube_m = {};          ///< tube of plans: tube_m()
  std::optional<LockstepCost> lockstep = {};  ///< only for runs in lockstep
};

/// Share of the offered packets that were not lost; NaN before the first.
double reception_ratio(const link_report_t& link);

/// Throws if the run's result is not a number: then it is invalid and has no summary.
void check_finite(const RunObserver& run);

/// One JSON object (docs/howto/running.md says what is in it).
std::string to_json(const Scenario& scenario, const RunObserver& run, const RunSummary& summary);

// Parts of both that a fleet's have, too.
void add_common(nlohmann::ordered_json& json, const Scenario& scenario, const RunSummary& summary);
std::string verdict_text(const std::vector<std::string>& findings);
/// Fates of packets on a shared medium; "" without one.
std::string medium_text(const std::map<std::string, std::int64_t>& counters, double sim_time_s);
/// How much was sent where only what changes is; "" where all is.
std::string sending_text(const std::map<std::string, std::int64_t>& counters);
std::string time_text(const Scenario& scenario, const RunSummary& summary);
/// Counters that must be zero in a healthy run.
std::string trouble_text(const std::map<std::string, std::int64_t>& counters);

/// A few lines for people.
std::string to_text(const Scenario& scenario, const RunObserver& run, const RunSummary& summary);

/// Result of a run; of a fleet, what it did as a whole, and each vehicle by its name; in words,
/// the worst few.
std::string to_json(const Scenario& scenario, const FleetObserver& fleet,
                    const RunSummary& summary);
std::string to_text(const Scenario& scenario, const FleetObserver& fleet,
                    const RunSummary& summary);

/// How a fleet stands at `now`, in two lines: ε in the mean and of the worst vehicle, up to now;
/// how many are lost, and collisions. Empty for a vehicle that is alone.
std::vector<std::string> fleet_now(const FleetObserver& fleet, Instant now);

}  // namespace tether
