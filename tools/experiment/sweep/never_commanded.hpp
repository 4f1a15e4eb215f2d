#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tools/experiment/statistics/stratified.hpp"
#include "tools/experiment/sweep/run_store.hpp"

namespace tether {

/// The probability that no command reaches a vehicle that sends `poses` poses: (1 − p q)^poses with
/// the packet reception ratios p of the uplink and q of the downlink, as each pose that arrives is
/// answered by one command, and all packets are lost independently of each other. `scenario`: as
/// resolved, TOML. nullopt where this is not so: other channel models than "fixed" or further
/// stages, changes of the channel, a delay (answers to the last poses are not sent before the end),
/// a trigger other than "event".
std::optional<double> never_commanded_probability(const std::string& scenario, std::size_t poses);

/// An arm's runs by whether any command arrived. Those without one stand still from beginning to
/// end, all with the same ε, and where few packets arrive how many there are of them by chance
/// makes most of the variance of the mean ε.
struct CommandedRuns {
  std::size_t runs = 0;               ///< number of runs that did not fail
  std::size_t never = 0;              ///< runs without a command
  std::optional<double> probability;  ///< probability of `never`; nullopt: not known
  /// ε by these two kinds of runs; NaN where the probability is not known or a kind has no run.
  StratifiedMean epsilon_m;
};
/// Runs of all arms, in their order.
std::vector<CommandedRuns> by_command(const RunStore& store);

/// One row an arm as CSV, through `write`: columns arm, the grid's keys, runs, never,
/// never_expected (runs times probability), the plain mean of ε and the stratified one with their
/// 95 % intervals (…_low, …_high); empty where there is none.
void export_stratified(const RunStore& store, const std::function<void(const std::string&)>& write);

}  // namespace tether
