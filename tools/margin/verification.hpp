#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"

namespace tether {

/// A critical value found by simulations at the predicted one and 15 % beside it: where
/// a quadratic through the logarithms of the growth changes sides, with the jackknife's
/// 95 % interval over the seeds.
struct SimulatedCritical {
  double value = 0.0;
  double low = 0.0, high = 0.0;
};

/// A critical value as the theory has it, and as simulations have it.
struct VerifiedCritical {
  enum class Quantity { prr, delay, excursion };
  Quantity quantity = Quantity::prr;
  std::optional<double> predicted;          ///< delays and times in s; none: `why` says why
  std::optional<SimulatedCritical> linear;  ///< none: nowhere near `predicted`
  std::optional<SimulatedCritical> full;    ///< none: nowhere near, or `why`
  std::string why;  ///< why there is nothing to compare, or why the full loop may differ

  /// By which share of `predicted`; NaN without either.
  double off(const std::optional<SimulatedCritical>& simulated) const;
  /// Within 5 % for the linear loop and 15 % for the full one, or there is a reason why not. Mean
  /// times to an excursion: the intervals of straight and whole loop overlap.
  bool holds() const;
};

struct VerificationTrial {
  std::size_t seeds = 10;  ///< from 1 on, at least 2
  std::size_t linear_loops = 500, linear_periods = 600;
  std::size_t full_loops = 150, full_periods = 100;
  std::size_t runs_a_seed = 20;  ///< runs of the whole loop, with noise
  std::size_t jobs = 1;          ///< threads; the result does not depend on it
};

/// Critical PRR (mean of both links, with more and more independent loss beside the scenario's own)
/// and critical delay from pose to wheels (with its losses; the sensor's latency is what varies),
/// across the path. With noise instead of both: the mean time to the first excursion, as
/// first_excursion() has it (in the place of the linear loop), and of whole runs. Throws UsageError
/// for margin_obstacles().
std::vector<VerifiedCritical> verify_margins(const Scenario& scenario,
                                             const VerificationTrial& trial);

}  // namespace tether
