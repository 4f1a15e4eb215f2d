#pragma once

#include <cstdint>
#include <string>

#include "tests/autonomy/campaign/fault.hpp"

namespace tether::test {

/// Results of one seeded run, to judge how much the runs cover.
struct TrialTotals {
  std::int64_t runs = 0;
  std::int64_t protective_stops = 0;
  std::int64_t requests = 0;
  std::int64_t remote_steps = 0;  ///< setpoints of the remote driver
  std::int64_t law_steps = 0;
  std::int64_t returns = 0;
  std::int64_t refused = 0;   ///< commands
  std::int64_t silences = 0;  ///< a remote driver was not heard any more
  std::int64_t obstacles = 0;
  std::int64_t localisation_losses = 0;
  double nearest_m = 1e9;  ///< distance of all objects that stood in view in time

  void add(const TrialTotals& other);
};

/// One run of 40 s: the vehicle's own driver (OnboardDriver) with a simulated vehicle, scanner and
/// localiser; obstacles that appear and vanish; a network that loses, delays, repeats and reorders
/// reports and commands, with bursts and outages; a remote driver who is honest, careless or behind
/// the times. With a fault the driver is not the shipping one.
/// Returns the first rule that was broken, with seed and time; "" if none was. The rules are
/// DrivingRules, and that nothing is touched that came into being farther away than the stopping
/// field at that time, and what the vehicle needs until it is seen.
std::string run_trial(std::uint64_t seed, TrialTotals& totals, Fault fault = Fault::none);

}  // namespace tether::test
