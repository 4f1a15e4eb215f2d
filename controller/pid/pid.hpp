#pragma once

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

}  // namespace tether
