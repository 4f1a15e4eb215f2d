#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tools/experiment/sweep/experiment.hpp"
#include "tools/experiment/sweep/grid.hpp"

namespace tether {

/// A law that `tether tune` has tuned.
struct TunedLaw {
  std::string name;
  std::vector<KeyValue> settings;       ///< the law, its rates and what else goes with it
  std::vector<KeyValue> gains;          ///< tuned keys
  std::string version;                  ///< version that tuned it
  std::vector<std::string> conditions;  ///< conditions that it was tuned for
  std::vector<std::uint64_t> seeds;     ///< trained on: no experiment may evaluate with them
  std::size_t evaluations = 0;          ///< number per search
  std::vector<double> found;            ///< the objective that each search found; the least counts
  /// The objective where the first search began, and with `gains`, on the training seeds.
  double before = 0.0, after = 0.0;
  /// The means of the metric, one for each of `conditions`.
  std::vector<double> means_before, means_after;

  bool operator==(const TunedLaw&) const = default;
};

/// A file of tuned gains (docs/howto/experiments.md), which experiments name by `gains` and of
/// which `tuned` takes a law's settings and gains.
struct Gains {
  std::string file;
  std::string command;         ///< command that makes it, of one version or, law by law, of several
  std::string objective;       ///< for people
  std::vector<TunedLaw> laws;  ///< in the order of the tuning file

  const TunedLaw* find(const std::string& law) const;  ///< null: it is not there
  bool operator==(const Gains&) const = default;
};

/// Throws UsageError that names file, line and what is allowed.
Gains read_gains(const std::string& file);
/// Content of a file, which reads as the same gains.
std::string to_toml(const Gains& gains);

/// `tuned = "NAME"` stands for the law's settings and gains, any other setting for itself. Throws
/// UsageError if there are no gains, or none of this name.
std::vector<PlacedSetting> expanded(const PlacedSetting& given, const std::optional<Gains>& gains);

/// Throws UsageError if a seed of the experiment is one of those that the gains were tuned with:
/// what it says of them would be too good.
void check_disjoint(const Gains& gains, const Experiment& experiment, const std::string& file);

}  // namespace tether
