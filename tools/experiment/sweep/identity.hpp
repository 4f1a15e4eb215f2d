#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>

#include "tools/experiment/sweep/experiment.hpp"

namespace tether {

class RunStore;

/// Which part of a sweep's runs: shard `index` of `count`; 1 of 1 is all.
struct Shard {
  std::size_t index = 1;  ///< from 1
  std::size_t count = 1;

  bool operator==(const Shard&) const = default;
};

/// Identity of a sweep, in addition to its arms, as "key" → text: name, version of the
/// program, plant, seeds, precision, …, and the contents of files that its scenarios name.
using Identity = std::map<std::string, std::string>;

Identity identity_of(const Experiment& experiment, const Shard& shard);

/// Throw UsageError that says what differs, what it was and what it is.
void check_same(const RunStore& store, const Identity& identity);
void check_same_arms(const RunStore& store, const Experiment& experiment);

/// "2/4", and back; throws UsageError for anything else.
std::string to_text(const Shard& shard);
Shard shard_of(const std::string& text);

}  // namespace tether
