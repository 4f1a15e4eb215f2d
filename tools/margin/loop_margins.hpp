#pragma once

#include <optional>

#include "common/scenario/scenario.hpp"
#include "tools/margin/mean_square.hpp"
#include "tools/margin/straight_loop.hpp"

namespace tether {

/// At the path's greatest speed between run.settled_from_s and the run's end, as if the path were
/// straight there (tools/margin/sampled_loop.hpp). Limits of speed and acceleration are not in it.
struct LoopMargins {
  double v_mps = 0.0;      ///< path speed
  double least_mps = 0.0;  ///< the least one
  double period_s = 0.0;
  double delay_s = 0.0;  ///< delay of sensor and both links
  double prr = 1.0;      ///< reception ratio of a pose and its answer together
  double radius = 0.0;   ///< growth of the mean square per period; stable below 1
  double radius_across = 0.0, radius_along = 0.0;
  Critical prr_each_way;               ///< both links fixed; the smallest that is stable
  Critical more_loss;                  ///< independent, each way, beside the channel's own
  std::optional<Critical> mean_burst;  ///< packets; both links gilbert_elliott, at their PRR
  struct Delays {
    Critical total_s;               ///< at this channel's losses
    double margin_s = 0.0;          ///< without sampling and losses
    double varying_margin_s = 0.0;  ///< the same for delays that vary; the hold is one of them
  };
  std::optional<Delays> delays;  ///< none with plans
  /// √E[d²] on the straight at that speed, by the sensor's white noise and the poses' delay;
  /// nullopt if unstable, or if the sensor has errors that are not white.
  std::optional<double> rms_m;
};

/// How much independent loss each way the loop bears beside its channel's own, 0 to 0.99.
Critical critical_more_loss(const StraightLoop& loop);
/// The longest that critical delays are looked for at: 0.5 s or twelve periods.
double longest_delay_s(double period_s);
/// How long poses may take in all with these losses.
Critical critical_delay(const StraightLoop& loop, const LossChain& chain);

/// Throws UsageError with all of margin_obstacles() if there are any.
LoopMargins loop_margins(const Scenario& scenario);

}  // namespace tether
