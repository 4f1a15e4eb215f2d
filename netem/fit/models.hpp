#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/random.hpp"
#include "netem/fit/data.hpp"
#include "netem/fit/delays.hpp"
#include "netem/fit/goodness.hpp"
#include "netem/fit/likelihood.hpp"
#include "netem/fit/parameter.hpp"
#include "netem/fit/stationarity.hpp"
#include "netem/models/gilbert_elliott.hpp"

namespace tether {

/// Maximum likelihood of one model.
struct ModelFit {
  std::string name;
  std::vector<FitParameter> parameters;
  double log_likelihood = 0.0;
  int free_parameters = 0;

  double aic() const { return 2.0 * free_parameters - 2.0 * log_likelihood; }
  double bic(std::int64_t packets) const;
};

/// A chain stepped by packets; independent loss is the one with p = 0 and loss 1−k.
struct PacketFit : ModelFit {
  GilbertElliott model;
};

struct MarkovFit : ModelFit {
  MarkovModel model;
  /// Mean delay of the packets received in each state, weighted with the probability of that state
  /// given all losses; NaN where the log has no delays.
  double delay_good_s = 0.0, delay_bad_s = 0.0;
  DelayFit delays;  ///< fit of the remainder after these are subtracted, with the same weights
};

/// Fit of a channel to its log.
struct ChannelFit {
  enum class Choice { independent, gilbert_elliott, markov };

  std::int64_t packets = 0;
  std::int64_t lost = 0;
  double interval_s = 0.0;
  bool periodic = false;
  DelayFit delays;  ///< delays of received packets
  /// Enough losses and receptions (kFewestEvents each) to tell models apart; else only independent
  /// loss is fitted, and goodness is not tested.
  bool enough = false;
  /// Independent; then p and r (1−h = 1, 1−k = 0: Gilbert's simplest); with 1−h; with 1−k; with
  /// both.
  std::vector<PacketFit> candidates;
  std::size_t best = 0;  ///< index of the best candidate, by BIC
  /// In time, with as many free parameters as the best candidate; none if that is independent, or
  /// if it has no positive correlation, which a process in time always has.
  std::optional<MarkovFit> markov;
  /// For periodic packets the two are the same; otherwise the more likely one of best and markov.
  Choice choice = Choice::independent;
  GoodnessOfFit goodness;  ///< fit of the chosen model
  Stationarity stationarity;

  bool fits() const { return goodness.fits() && stationarity.holds(); }
};

inline constexpr std::int64_t kFewestEvents = 20;

/// Fits every model by direct maximisation of the likelihood, from several starts. `random` is for
/// the goodness of fit. Throws UsageError if `log` has no two packets.
ChannelFit fit_channel(const FateLog& log, RandomEngine random);

}  // namespace tether
