#pragma once

#include <cstddef>
#include <filesystem>

#include "tools/experiment/sweep/experiment.hpp"
#include "tools/experiment/sweep/identity.hpp"

namespace tether {

struct SweepOutcome {
  std::filesystem::path database;
  std::size_t runs = 0, failed = 0;  ///< in the database
  std::string first_failure;         ///< which and why, or ""
  bool is_complete = false;          ///< false: interrupted, or runs are missing
  double wall_time_s = 0.0;          ///< sum over all its sessions
  std::string plant;
};

/// One a core that this process may use.
std::size_t default_jobs();

/// Makes what is missing of a sweep in `folder`, which is made if need be, and shows progress on
/// stderr, where it also names the runs that run_sweep() could not make. Ctrl-C and SIGTERM end it
/// after the runs under way; a second one at once. Throws UsageError if the folder cannot be made,
/// or another process is sweeping there; and as RunStore.
SweepOutcome sweep_into(const std::filesystem::path& folder, const Experiment& experiment,
                        const Shard& shard, std::size_t jobs);

}  // namespace tether
