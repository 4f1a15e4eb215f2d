#include "can_bridge/safety/wheel_motion.hpp"

#include <algorithm>
#include <cmath>

namespace tether {

void WheelMotion::forget() {
  speed_stamp_.reset();
  spans_.clear();
}

void WheelMotion::on_speed(double radps, Instant now) {
  speed_radps_ = radps;
  speed_stamp_ = now;
}

void WheelMotion::on_position(double angle_rad, Instant now) {
  if (!spans_.empty() && now - spans_.back().until > pause_) spans_.clear();
  if (!spans_.empty() && now - spans_.back().from < kThin) {
    Span& span = spans_.back();
    span.until = now;
    span.low_rad = std::min(span.low_rad, angle_rad);
    span.high_rad = std::max(span.high_rad, angle_rad);
    span.last_rad = angle_rad;
  } else {
    spans_.push_back({now, now, angle_rad, angle_rad, angle_rad});
  }
  while (spans_.size() > 2 && now - spans_[1].from >= kWindow) spans_.pop_front();
}

Motion WheelMotion::by_speed(Instant now, Duration timeout) const {
  if (!speed_stamp_ || now - *speed_stamp_ >= timeout) return Motion::unknown;
  return std::abs(speed_radps_) < standstill_radps_ ? Motion::standing : Motion::turning;
}

Motion WheelMotion::by_position(Instant now, Duration timeout) const {
  if (spans_.empty() || now - spans_.back().until >= timeout) return Motion::unknown;
  double low_rad = spans_.front().low_rad, high_rad = spans_.front().high_rad;
  for (const Span& span : spans_) {
    low_rad = std::min(low_rad, span.low_rad);
    high_rad = std::max(high_rad, span.high_rad);
  }
  const Duration window = spans_.back().until - spans_.front().from;
  const double allowed_rad = standstill_radps_ * to_seconds(window) + count_rad_;
  constexpr double kRounding = 1.0 + 1e-9;
  if (high_rad - low_rad > allowed_rad * kRounding) return Motion::turning;
  return window >= kWindow ? Motion::standing : Motion::unknown;
}

Motion WheelMotion::judge(Instant now, Duration timeout) const {
  const Motion speed = by_speed(now, timeout), position = by_position(now, timeout);
  if (speed == Motion::turning || position == Motion::turning) return Motion::turning;
  const bool both = speed == Motion::standing && position == Motion::standing;
  return both ? Motion::standing : Motion::unknown;
}

Motion WheelMotion::newest() const {
  if (!speed_stamp_ || spans_.empty()) return Motion::unknown;
  return judge(std::max(*speed_stamp_, spans_.back().until), pause_);
}

std::optional<double> WheelMotion::counted_radps(Instant now) const {
  if (spans_.size() < 2 || now - spans_.back().until >= timeout_) return std::nullopt;
  const Span& first = spans_.front();
  const Span& last = spans_.back();
  return (last.last_rad - first.last_rad) / to_seconds(last.until - first.until);
}

std::optional<double> WheelMotion::reported_radps(Instant now) const {
  if (!speed_stamp_ || now - *speed_stamp_ >= timeout_) return std::nullopt;
  return speed_radps_;
}

std::optional<double> WheelMotion::fastest_radps(Instant now) const {
  const std::optional<double> counted = counted_radps(now), reported = reported_radps(now);
  if (!counted || !reported) return counted ? counted : reported;
  return std::abs(*reported) > std::abs(*counted) ? reported : counted;
}

}  // namespace tether
