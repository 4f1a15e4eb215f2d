#pragma once

#include <string>
#include <vector>

#include "netem/link/link_config.hpp"

namespace tether {

/// One of the values of jitter.law: the single place that knows its name and what it uses. A new
/// one is a value of JitterConfig::Law and a row in jitter_laws.cpp.
struct JitterLaw {
  JitterConfig::Law law;
  std::string name;
  std::vector<std::string> keys;  ///< of [jitter], those that it uses besides law itself
  /// x(z) (netem/link/delay_law.hpp) at equal steps of z over ±kMaxScore, for sd_s > 0; seconds.
  /// Null for laws that DelayLaw knows without a table of scores.
  std::vector<double> (*tabulate)(const JitterConfig&, double mean_s, double sd_s) = nullptr;

  bool uses(const std::string& key) const;
};

/// All laws, in the order in which messages name them.
const std::vector<JitterLaw>& jitter_laws();
const JitterLaw& jitter_law(JitterConfig::Law law);

}  // namespace tether
