#pragma once

#include <memory>

#include "controller/laws/network_estimate.hpp"
#include "controller/laws/pid_law.hpp"

namespace tether {

/// The paper's law with the look-ahead that suits the network, as the paper suggests. At each pose,
/// τ is taken from the table, by the PRR and the delay that are estimated from the poses so far.
/// The controller has no report on downlink losses, so it assumes those of the uplink.
class AdaptivePidLaw final : public PidLaw {
 public:
  /// `factor`: times the table's look-aheads, which were found for other gains or another rate.
  AdaptivePidLaw(const LawContext& context, TauTable table, double factor);

  void on_pose(const SeenPose& seen) override;
  void list_counters(CounterList& out) const override;

 private:
  TauTable table_;
  double factor_;
  ReceptionEstimate reception_;
  DelayEstimate delay_;
  double tau_s_ = 0.0;
};

}  // namespace tether
