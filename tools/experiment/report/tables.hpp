#pragma once

#include <string>
#include <vector>

#include "tools/experiment/sweep/data.hpp"
#include "tools/experiment/sweep/run_store.hpp"

namespace tether {

/// A table of [[table]], for people and as data.
struct SweepTable {
  std::string title;
  std::string note;                            ///< note on its cells
  std::vector<std::vector<std::string>> rows;  ///< the first is the head
  std::string csv;                             ///< one row a cell or comparison, with a head
};

/// Means with their 95 % intervals, a row for each combination of the keys that are neither columns
/// nor the same in all arms; empty cells where the sweep has no such arm.
SweepTable means_table(const SweepData& data, const TableChoice& choice);
/// mean(over)/mean(under) on the same seeds, with its 95 % interval, and whether it reaches
/// `choice.limit`: "yes" if the whole interval does, "mean only", or "no".
SweepTable ratio_table(const SweepData& data, const TableChoice& choice);
/// Where along `choice.key` the mean first reaches `choice.limit`: between which two of the values
/// tried, and where by linear interpolation.
SweepTable limit_table(const SweepData& data, const TableChoice& choice);

/// All tables of a sweep, in the order of its file.
std::vector<SweepTable> tables_of(const RunStore& store);

}  // namespace tether
