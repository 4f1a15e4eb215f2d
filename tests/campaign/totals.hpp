#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "tests/campaign/record.hpp"

namespace tether::campaign {

/// A rule that a seed broke.
struct Finding {
  std::uint64_t seed = 0;
  std::string rule;
  Instant when;
  std::string what;
};

/// Totals of many runs. Sums, so their order is of no account.
struct Totals {
  std::int64_t runs = 0;
  std::int64_t armed_runs = 0;
  double simulated_s = 0.0;
  double armed_s = 0.0;
  double driven_m = 0.0;
  std::map<std::string, std::int64_t> faults;
  std::map<std::string, std::int64_t> stops;
  std::vector<Finding> findings;
  /// Fingerprint of all states and wheel speeds: the same runs give the same, whatever else is the
  /// same.
  std::uint64_t fingerprint = 0;

  /// With the rules that it breaks.
  void add(std::uint64_t seed, const Record& record);
  void add(const Totals& other);
  /// For people: a line for each, findings by seed.
  std::string text() const;
};

/// The rules that a record breaks.
std::vector<Finding> check(std::uint64_t seed, const Record& record);

}  // namespace tether::campaign
