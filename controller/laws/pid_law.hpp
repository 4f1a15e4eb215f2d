#pragma once

#include <istream>
#include <memory>
#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "common/path/reference_path.hpp"
#include "common/vehicle/pose.hpp"
#include "controller/laws/law.hpp"

namespace tether {

/// PID on one error, with saturated output.
///
/// u = P·e + I·∫e dt + D·d(e_f)/dt, limited to ±limit. e_f is the error behind a first-order
/// low-pass (time constant `derivative_filter_s`, backward Euler). Anti-windup by conditional
/// integration: the integral stands still while the output is saturated and the error would push
/// it further (Åström & Hägglund, PID Controllers, 2nd ed., section 3.5).
///
/// The first step after construction or reset() has neither derivative nor integral, whatever dt.
class Pid {
 public:
  struct Config {
    double p = 0.0;
    double i = 0.0;  ///< 1/s
    double d = 0.0;  ///< s
    double limit = 0.0;
    double derivative_filter_s = 0.0;
    bool angular = false;  ///< the error is an angle: its differences are wrapped to (−π, π]
  };

  explicit Pid(const Config& config) : config_(config) {}

  /// `dt_s` since the last step, ≥ 0; with 0 the derivative and the integral stay as they were.
  double step(double error, double dt_s);
  void reset() { state_ = {}; }

 private:
  struct State {
    bool started = false;
    double filtered_error = 0.0;
    double derivative = 0.0;
    double integral = 0.0;
  };
  Config config_;
  State state_;
};

/// The best look-ahead τ by packet reception ratio and delay, from the means of a sweep: a CSV with
/// columns channel.prr, channel.delay_ms (optional: then 0), controller.tau_s and epsilon_m. Rows
/// with one PRR and delay are candidates of which the one with the least ε is chosen; several rows
/// of one candidate (the seeds of a sweep) are averaged, empty values of ε (failed runs) left out.
///
///   tether sweep experiments/tau_table.toml && tether sweep export out/tau_table --means
class TauTable {
 public:
  /// `name` stands for the file in messages. Throws UsageError for what is missing or no number.
  static TauTable read(std::istream& in, const std::string& name);

  /// τ for a network as estimated: linear between the table's PRRs and delays, which need to be a
  /// grid; the nearest edge outside.
  double tau_s(double prr, double delay_ms) const;

 private:
  double at(std::size_t prr, std::size_t delay) const {
    return tau_s_[prr * delays_ms_.size() + delay];
  }

  std::vector<double> prrs_;       ///< ascending
  std::vector<double> delays_ms_;  ///< ascending
  std::vector<double> tau_s_;      ///< by PRR, then delay
};

/// The paper's control law: two PIDs on the errors to the point of the path τ seconds ahead,
///   θ_e = atan2(y*(t+τ) − y, x*(t+τ) − x) − θ, wrapped to (−π, π]  → ω
///         (not wrapped with wrap_heading = false, where the vehicle may turn the long way round)
///   d_e = hypot(x*(t+τ) − x, y*(t+τ) − y)                        → v
/// (x, y) is the axle's midpoint, or a point `ahead_m` ahead of it, which then is what follows the
/// path (path.point).
/// Since d_e ≥ 0 and all gains are ≥ 0, it hardly ever drives backwards.
class PidLaw : public Law {
 public:
  PidLaw(const ControllerSettings& config, std::shared_ptr<const ReferencePath> path,
         double ahead_m = 0.0);

  /// The command at `now` for a vehicle last seen at `pose`. Times of successive calls must not
  /// decrease.
  Twist step(const Pose2& pose, Instant now);
  LawOutput decide(Instant now, const SeenPose* newest) override { return step(newest->pose, now); }
  /// Forgets everything: the next step is a first one.
  void reset() override;

  /// θ_e and d_e of the last step.
  LawErrors errors() const override { return errors_; }

  void set_look_ahead(double tau_s) override { tau_s_ = tau_s; }

 private:
  std::shared_ptr<const ReferencePath> path_;
  double ahead_m_;
  double tau_s_;
  bool wrap_heading_;
  Pid v_;
  Pid omega_;
  LawErrors errors_;
  Instant last_{};
};

}  // namespace tether
