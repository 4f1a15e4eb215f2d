#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "tools/experiment/design/gains.hpp"
#include "tools/experiment/tune/tuning.hpp"

namespace tether {

/// What a law's runs with one set of values are worth: `metrics` of each condition's runs, NaN of
/// a run that failed, which counts as the worst. Returns the means by condition and of them the
/// objective.
struct Worth {
  std::vector<double> means;
  double objective = 0.0;
};
Worth worth_of(const Tuning& tuning, const std::vector<std::vector<double>>& metrics);

/// Tunes all laws, round by round (search.hpp): all candidates of all laws in a round are one
/// sweep, in `folder`/round1 and so on, all with the training seeds. So the result does not depend
/// on `jobs`, and what was interrupted goes on where it stood. Shows progress on stderr. Nullopt:
/// interrupted. Throws as sweep_into().
///
/// The values that the scenario has are a candidate too, and win where nothing is better, so that
/// tuning never makes the objective worse.
std::optional<Gains> tune(const Tuning& tuning, const std::filesystem::path& folder,
                          std::size_t jobs, const std::string& command);

}  // namespace tether
