#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"

namespace tether {

/// Runs of the whole loop on a straight, whose deviations across it are so small (noise of 1 µm and
/// 1 µrad) that limits, which are not in the theory, play no part.
struct StraightTrial {
  std::size_t runs = 60;  ///< at least kGroups; with seeds from `seed` on
  std::size_t periods = 4000;
  std::uint64_t seed = 1;
  std::size_t jobs = 1;  ///< threads; the result does not depend on it
  static constexpr std::size_t kGroups = 10;
};

/// Why a scenario's runs cannot be compared with the theory; "" if they can: its path is a straight
/// with one speed.
std::string why_no_trial(const Scenario& scenario);

/// How the deviations of random loops are spread. A loop whose matrices are drawn at random has
/// errors beyond x in a share of the time that falls as x^−α, where α is such that E|product|^α
/// neither grows nor shrinks (Kesten, Acta Math. 131, 1973; Goldie, Ann. Appl. Probab. 1, 1991;
/// with a Markov chain: de Saporta, Stoch. Process. Appl. 115, 2005). So the mean square is finite
/// if and only if α > 2: that is what is measured, while the mean square itself, near the edge, is
/// that of errors so rare that no number of runs has them.
struct Tail {
  std::vector<std::vector<double>> logs;  ///< of the deviations, by group of runs

  /// α by Hill's estimator (Ann. Statist. 3, 1975) on the largest 1 %; of all but group `without`.
  /// If these are beyond 1 cm, 10 000 times the noise, limits bend the tail, and α is what the
  /// share beyond 1 cm says: at most 0.5.
  double exponent(std::size_t without = StraightTrial::kGroups) const;
};

/// Each link loses `more_loss` of its packets, independently, beside what it loses. The scenario
/// has no margin_obstacles() and no why_no_trial().
Tail simulated_tail(const Scenario& scenario, double more_loss, const StraightTrial& trial);

/// log of the growth of the deviation per period without noise, of a loop that loses nothing: it
/// starts 1 mm beside the straight. From one run, over 10 s or 100 periods.
double simulated_growth(const Scenario& scenario);

}  // namespace tether
