#pragma once

#include <Eigen/Core>
#include <vector>

#include "tools/margin/mean_square.hpp"

namespace tether {

/// How the path moves at some time.
struct PathMotion {
  double v_mps = 0.0;
  double omega_radps = 0.0;

  bool operator==(const PathMotion&) const = default;
};

/// ∂(v, ω)/∂(x_e, y_e, θ_e) of a law, at no error.
using LawJacobian = Eigen::Matrix<double, 2, 3>;

/// Jacobian of the tracking law (controller/laws/tracking_law.hpp) at path speed v:
/// δv = K_x x_e, δω = v (K_y y_e + K_θ θ_e). Its bounds on catching up, its atan2 and its limits
/// are of second order, or beyond.
LawJacobian tracking_jacobian(double k_x, double k_y, double k_theta, double v_mps);

struct LoopTiming {
  double period_s = 0.05;        ///< between poses; each is answered by a command
  double pose_delay_s = 0.0;     ///< from a pose's measurement to the decision
  double command_delay_s = 0.0;  ///< from the decision to the wheels
  double total_s() const { return pose_delay_s + command_delay_s; }
};

/// Standard deviations, white.
struct PoseNoise {
  double position_m = 0.0;  ///< each axis
  double yaw_rad = 0.0;
};

/// Events in the period from a pose to the next.
struct LoopPeriod {
  PathMotion decided;  ///< where the law aims when it answers the pose
  PathMotion early;    ///< motion of the aim until a command takes effect
  PathMotion late;     ///< from then on
  LawJacobian law;     ///< at `decided`
};

/// One period of the loop, linearised at no error. The errors in the vehicle's frame of Kanayama et
/// al. (ICRA 1990), of the path shifted by the pose's delay, at which the law really aims,
///   ẋ_e = ω_r y_e + v_r − v,   ẏ_e = −ω_r x_e + v_r θ_e,   θ̇_e = ω_r − ω,
/// are integrated exactly for the path motions given; the twist in force holds until another takes
/// its place (zero-order hold). With a delay D = m h + δ the command of the pose m periods ago
/// takes effect δ after this pose, or is lost. State: x_e, y_e, θ_e, the twist in force, the m
/// twists under way (newest first), 1.
LoopStep sampled_step(const LoopPeriod& period, const LoopTiming& timing, const PoseNoise& noise);

/// A law of plans: each pose is answered, at once, by the twists that the law gives the vehicle
/// from that pose on, in steps of `step_s`; until the next one arrives, the vehicle follows them.
struct PlannedPeriod {
  PathMotion path;
  LawJacobian law;
  double step_s = 0.05;
  int steps = 1;  ///< from a pose to the next
};

/// One period of such a loop. In each step both the errors and those that the plan in force means
/// the vehicle to have (ê) move by the twist u_r + K ê (packetised predictive control: Quevedo,
/// Nešić, IEEE Trans. Autom. Control 56 (2), 2011); a pose that is answered sets ê to what it
/// measures. Plans are longer than silences. State: x_e, y_e, θ_e, the three of ê, 1.
LoopStep planned_step(const PlannedPeriod& period, const PoseNoise& noise);

/// Part of the state under consideration. On a straight path `across` (y_e, θ_e, ω) and `along`
/// (x_e, v) do not depend on each other (LoopStep::is_along); `all` leaves out the 1, for
/// mean_square_radius().
enum class LoopPart { all, across, along };
LoopStep part_of(const LoopStep& step, LoopPart part);

/// mean_square_radius() of a loop of plans, whose matrices are block triangular in e − ê and ê:
/// e − ê ends where a pose is answered, and else grows no faster than a power of time on a straight
/// path; ê shrinks as the law has it.
double planned_radius(const LossChain& chain, const PlannedPeriod& period, LoopPart part);

/// E[d²] of the distance d to the path's point of now, which the law's aim is ahead of by so much:
/// v·pose delay, less what the law holds the vehicle behind its aim.
double square_distance(const Eigen::MatrixXd& moments, double ahead_m);

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
