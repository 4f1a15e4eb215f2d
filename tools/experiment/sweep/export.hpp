#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "tools/experiment/sweep/run_store.hpp"

namespace tether {

/// The runs of a sweep as CSV, through `write`, piece by piece: by arm, then seed; columns arm, the
/// grid's keys, seed, plant, failure, metrics. Equal sweeps give equal bytes, however many threads,
/// shards and interruptions they had.
void export_runs(const RunStore& store, const std::function<void(const std::string&)>& write);

/// One row an arm: columns arm, the grid's keys, plant, runs that did not fail, failed ones, and of
/// each metric the mean and its 95 % interval (…_low, …_high), to 6 digits; empty if there is none.
void export_means(const RunStore& store, const std::function<void(const std::string&)>& write);

/// A database of a folder: its runs.sqlite; or the file itself.
std::filesystem::path database_of(const std::filesystem::path& folder_or_file);

/// The database in a folder of the runs of a shard.
std::filesystem::path database_in(const std::filesystem::path& folder, const Shard& shard);

/// Copies the runs of all shards of one sweep into a new database at `file`. `shards`: databases,
/// or folders of which each has its shard-*.sqlite. Throws UsageError, and leaves nothing behind,
/// if `file` exists, a shard is missing, there twice, incomplete, or another sweep's.
void merge_shards(const std::filesystem::path& file,
                  const std::vector<std::filesystem::path>& shards);

}  // namespace tether
