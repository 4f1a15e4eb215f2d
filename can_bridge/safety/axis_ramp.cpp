#include "can_bridge/safety/axis_ramp.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace tether {
namespace {

/// rate + (rate − step) + (rate − 2·step) + … over the positive terms.
double staircase_sum(double rate, double step) {
  if (rate <= 0.0) return 0.0;
  const double n = std::max(0.0, std::ceil(rate / step) - 1.0);
  return (n + 1.0) * rate - step * n * (n + 1.0) / 2.0;
}

/// Inverse of staircase_sum: with n terms, sum = n·rate − step·n(n−1)/2, of which n is the smallest
/// number with sum ≤ step·n(n+1)/2.
double staircase_top(double sum, double step) {
  if (sum <= 0.0 || step <= 0.0) return 0.0;
  const double n = std::max(1.0, std::ceil((std::sqrt(1.0 + 8.0 * sum / step) - 1.0) / 2.0));
  return sum / n + step * (n - 1.0) / 2.0;
}

/// The largest rate towards zero that can be taken back, step by step, to `away` before zero is
/// crossed. Zero is `distance` away (in rates · cycle). A staircase with n terms from `away` on
/// covers n·away + step·n(n−1)/2; n is the largest number for which that is < distance.
double crossing_rate(double distance, double away, double step) {
  const double b = away - step / 2.0;
  const double n = std::ceil((std::sqrt(b * b + 2.0 * step * distance) - b) / step) - 1.0;
  if (n < 1.0) return away;
  return std::min(away + n * step, distance / n + step * (n - 1.0) / 2.0);
}

}  // namespace

AxisRamp::AxisRamp(const Limits& limits, double cycle_s)
    : limits_(limits),
      cycle_s_(cycle_s),
      step_(limits.jerk * cycle_s),
      stop_step_(limits.stop_jerk * cycle_s) {
  assert(cycle_s > 0.0);
  assert(limits.acceleration > 0.0 && limits.jerk > 0.0);
  assert(limits.deceleration >= limits.acceleration);
  assert(limits.stop_jerk >= limits.jerk);
}

void AxisRamp::reset(double value) {
  value_ = value;
  rate_ = 0.0;
  releasing_ = false;
}

AxisRamp::Share AxisRamp::limits_towards(double target, bool stopping) const {
  const double step = stopping ? stop_step_ : step_;
  const bool slowing = (target - value_) * value_ < 0.0;
  if (!slowing) return {limits_.acceleration, step};
  if (target * value_ >= 0.0) return {limits_.deceleration, step};
  const double crossing = crossing_rate(std::abs(value_) / cycle_s_, limits_.acceleration, step_);
  return {std::min(limits_.deceleration, crossing), step};
}

void AxisRamp::step(double target, const Share& share, bool stopping) {
  if (stopping) releasing_ = true;
  const double step = stopping ? stop_step_ : step_;
  const double difference = target - value_;
  double sign = rate_ > 0.0 ? -1.0 : 1.0;
  if (difference != 0.0) sign = difference > 0.0 ? 1.0 : -1.0;

  const double towards = sign * rate_;  // negative: it moves away from the target
  const double wanted = std::min(
      share.rate, staircase_top(std::abs(difference) / cycle_s_, std::min(step, share.rate_step)));
  double lowest = 0.0, highest = 0.0;
  if (towards < 0.0) {
    lowest = towards;
    highest = std::min(towards + release_step(), std::max(0.0, towards + step));
  } else {
    lowest = std::max(towards - release_step(), std::min(0.0, towards - step));
    highest = towards + std::min(step, share.rate_step);
  }
  rate_ = sign * std::clamp(wanted, lowest, highest);
  value_ += rate_ * cycle_s_;
  // The last step lands on the target but for rounding, which must not start another approach.
  if (std::abs(target - value_) <= 1e-12 * std::max(1.0, std::abs(target))) value_ = target;
  if (!stopping && std::abs(rate_) <= step_) releasing_ = false;
}

double AxisRamp::resting_value() const {
  const double step = release_step();
  return value_ + std::copysign(cycle_s_ * staircase_sum(std::abs(rate_) - step, step), rate_);
}

double AxisRamp::occupied() const { return std::max(std::abs(value_), std::abs(resting_value())); }

}  // namespace tether
