#pragma once

#include <string>
#include <vector>

#include "netem/statistics/channel_expectation.hpp"
#include "netem/statistics/delay_statistics.hpp"
#include "netem/statistics/estimate.hpp"
#include "netem/statistics/loss_record.hpp"
#include "netem/statistics/sojourn_statistics.hpp"

namespace tether {

enum class Verdict {
  ok,              ///< the configured value lies within an interval narrow enough to mean something
  outside,         ///< it does not lie within the interval: model or program is wrong
  too_short,       ///< it does, but the interval is too wide to mean anything
  not_comparable,  ///< nothing predicts the value, such as of bursts under irregular traffic
};
/// "ok", "outside", "too short", "not comparable".
std::string to_string(Verdict verdict);

/// One quantity of a channel, as configured and as it came out.
struct ChannelCheck {
  std::string quantity;     ///< "PRR", "mean loss burst", "lag-1 correlation", "delay p99", …
  std::string unit;         ///< "", "packets", "s", "ms"
  double configured = 0.0;  ///< NaN: nothing predicts it
  Estimate achieved;        ///< with the interval that is shown; the verdict's own is wider
  Verdict verdict = Verdict::ok;
  std::string reason;  ///< why it is not comparable, or what else to know; often empty
};

struct ChannelCheckOptions {
  /// Confidence of the intervals that are shown.
  double shown_confidence = 0.95;
  /// Probability that a right channel gets any "outside" at all in a report. Shared equally among
  /// its quantities (Bonferroni), so that each interval's level is 1 −
  /// false_alarm/quantities: 99.99 % for ten of them.
  double false_alarm = 1e-3;
  /// "ok" requires an interval whose half-width is at most this share of the configured value (of
  /// the rarer fate's probability for the PRR; of 1 for correlations; for delays of half the
  /// distance from their median to p99 if that is more).
  double precision = 0.25;
  /// With fewer effective samples than this, only the PRR is judged: variances are asymptotic.
  double least_samples = 30.0;
  /// Above this variation of the intervals between packets, bursts and correlation are not
  /// predicted for models in time.
  double most_interval_variation = 0.05;
};

/// Compares. `sojourns` may be null where states cannot be seen; then they are left out, as is
/// every quantity that the model leaves undefined (bursts where nothing is lost).
std::vector<ChannelCheck> compare_channel(const ChannelExpectation& expected,
                                          const LossRecord& loss, const DelayStatistics& delays,
                                          const SojournStatistics* sojourns,
                                          const ChannelCheckOptions& options = {});

/// outside if any is; else too_short if any is; else ok; not_comparable if nothing is comparable.
Verdict overall(const std::vector<ChannelCheck>& checks);

}  // namespace tether
