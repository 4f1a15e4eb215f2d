#pragma once

#include "common/world/onboard_settings.hpp"

namespace tether {

/// How much free way a vehicle needs ahead of it, and how fast it may be with what it has. The way
/// of stopping at a constant deceleration a after a time of reaction t, and a margin:
///   field(v) = v²/(2a) + |v| t + margin.
struct StoppingField {
  double deceleration_mps2 = 1.0;  ///< > 0
  double reaction_s = 0.2;
  double margin_m = 0.3;

  explicit StoppingField(const AutonomySettings& settings)
      : deceleration_mps2(settings.deceleration_mps2),
        reaction_s(settings.reaction_s),
        margin_m(settings.margin_m) {}

  double length_m(double v_mps) const;
  /// The largest speed whose field fits into `clear_m`; 0 where none does.
  double allowed_mps(double clear_m) const;
};

}  // namespace tether
