#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"
#include "tools/experiment/sweep/experiment.hpp"
#include "tools/margin/mean_square.hpp"

namespace tether {

struct LinearTrial {
  std::size_t loops = 1000;
  std::size_t periods = 600;  ///< the first third only settles
  std::uint64_t seed = 1;
};

/// Growth of E|z|² per period, from simulated loops with drawn losses instead of the operator of
/// mean_square_radius(). Near the edge the mean square is that of rare loops, which a plain average
/// does not have: hence a population whose members are resampled after each period in proportion
/// to |z|², while the mean growth is noted (Giardinà, Kurchan, Peliti: Direct evaluation of
/// large-deviation functions, Phys. Rev. Lett. 96, 2006). The error falls as 1/√(loops · periods),
/// the bias as 1/loops.
double simulated_radius(const LossChain& chain, const std::vector<LoopStep>& steps,
                        const LinearTrial& trial);

/// Whole loops on a straight: controller, relay and plant.
struct PopulationTrial {
  std::size_t loops = 150;
  std::size_t periods = 100;  ///< periods that count; the loops settle for 120 before them
  std::uint64_t seed = 1;
};

struct PopulationGrowth {
  double log_radius = 0.0;  ///< log of the growth of the mean square per period
  double largest_m = 0.0;   ///< deviation of any loop; the theory is about small ones
  double speed_off = 0.0;   ///< largest share that a speed was off by; the theory's is constant
};

/// Why a scenario's runs cannot be compared with the theory; "" if they can: its path is a straight
/// with one speed.
std::string why_no_trial(const Scenario& scenario);

/// Like simulated_radius() of tools/margin/linear_trial.hpp, but of the loops that ship, without
/// noise. When losses begin, errors along the straight have settled to less than 0.1 um. Errors
/// across stay far below a millimetre, so that limits, which are not in the theory, play no part,
/// and far above rounding. Every few periods loops are resampled in proportion to their squares. A
/// loop is copied by a second run that meets the same luck until now, and another from now on:
/// models of channels are Markov chains, so any of the same state goes on like it. Without losses
/// all loops are equal: then there is one.
///
/// Each link loses `more_loss` of its packets, independently, beside what it loses. The scenario
/// has no margin_obstacles() and no why_no_trial().
PopulationGrowth whole_loop_growth(const Scenario& scenario, double more_loss,
                                   const PopulationTrial& trial);

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

/// A table of an experiment's critical values: the grid's settings; predicted and simulated values,
/// their 95 % intervals, by how much they are off; and why there is none.
class VerificationTable {
 public:
  explicit VerificationTable(const Experiment& experiment);

  std::string head() const;
  std::string row(const Arm& arm, const VerifiedCritical& row) const;

 private:
  std::string line(const std::vector<std::string>& settings,
                   const std::vector<std::string>& cells) const;

  std::vector<std::string> keys_;
  std::vector<std::size_t> widths_;  ///< widths of the settings' columns
};

nlohmann::ordered_json verification_json(const Arm& arm, const VerifiedCritical& row);

}  // namespace tether
