#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "tools/experiment/sweep/front.hpp"
#include "tools/experiment/sweep/gains.hpp"
#include "tools/experiment/sweep/tuning.hpp"

namespace tether {

/// Which laws of a tuning are tuned, and what becomes of the others.
struct TuneChoice {
  std::vector<std::string> laws;  ///< by name; none: all
  std::vector<TunedLaw> kept;     ///< others, as they are; one that is not here is left out

  bool is_to_be_tuned(const std::string& law) const;
};

/// `kept`: a file that has all others, tuned for the same, with one aim and the same effort; empty:
/// none. Throws UsageError that says what is not so.
TuneChoice chosen(const Tuning& tuning, std::vector<std::string> laws, const std::string& kept);

/// Result of a tuning.
struct TuneResult {
  std::vector<Gains> gains;       ///< one for each of the tuning's aims
  std::vector<FrontPoint> front;  ///< with front_seeds, of the laws that were tuned
};

/// Tunes laws one after another, each independently of the others, and round by round (search.hpp):
/// all candidates of all of a law's searches in a round are one sweep, in `folder`/LAW/round1 and
/// so on, all with the training seeds. So the result does not depend on `jobs` nor on which laws
/// are tuned together, and what was interrupted goes on where it stood. Shows progress on stderr.
/// Nullopt: interrupted. Throws as sweep_into().
///
/// The start and what was known are candidates, too, and win where nothing is better. With
/// `front_seeds`, the front of all candidates that were tried of a law, by share of lost runs and
/// error of the others on the training seeds, is measured with these in `folder`/LAW/front.
std::optional<TuneResult> tune(const Tuning& tuning, const TuneChoice& choice,
                               const std::filesystem::path& folder, std::size_t jobs,
                               const std::string& command);

/// LAW of the above: "PID, 1/1 Hz" has PID-1-1-Hz.
std::string folder_of(const std::string& law);

}  // namespace tether
