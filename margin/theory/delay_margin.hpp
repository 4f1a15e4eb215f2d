#pragma once

namespace tether {

/// The tracking law's loop across the path without sampling, L(s) = (a s + b)/s² with a = K_θ v and
/// b = K_y v². Gains > 0, v > 0 m/s.
struct SteeringLoop {
  double k_y = 0.8;
  double k_theta = 2.0;
  double v_mps = 1.0;

  /// ω at which |L| = 1, rad/s: ω² = (a² + √(a⁴ + 4b²))/2.
  double crossover_radps() const;
  /// The constant delay at which it begins to oscillate: atan(aω/b)/ω at the crossover, s.
  double delay_margin_s() const;
  /// Delays that vary as they like between 0 and this leave it stable, s: 1/max_ω |ω T(jω)|,
  /// T = L/(1 + L) (C.-Y. Kao, B. Lincoln: Simple stability criteria for systems with time-varying
  /// delays. Automatica 40 (8), 2004). By small gain: what a delay τ(t) ≤ δ takes away is an
  /// integral of the input's rate over τ, with a gain of at most δ. Sufficient, not necessary. A
  /// hold of period h is such a delay, from 0 to h; lost commands make it longer.
  double varying_delay_margin_s() const;
};

}  // namespace tether
