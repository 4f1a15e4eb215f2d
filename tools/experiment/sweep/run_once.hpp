#pragma once

#include <cstddef>
#include <functional>

#include "common/scenario/scenario.hpp"
#include "tools/experiment/sweep/run_result.hpp"

namespace tether {

/// Result of `run`; or what it throws as a failure, to be repeated if it is this machine's: a
/// NoResult, memory, or a system call that failed.
RunResult result_of(const std::function<RunResult()>& run);

/// Runs the loop in virtual time, in this thread. ε and the other metrics are those of `tether
/// run`. `trajectory_period_s`: 0 for no trajectory. Whatever the run throws becomes its failure.
/// `arm`: for controller.command, whose program runs beside this thread; a warm one serves all runs
/// of the thread, and ends with it.
RunResult run_once(const Scenario& scenario, double trajectory_period_s, std::size_t arm = 0);

}  // namespace tether
