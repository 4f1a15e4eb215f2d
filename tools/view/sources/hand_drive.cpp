#include "tools/view/sources/hand_drive.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "common/base/errors.hpp"
#include "tools/base/json.hpp"

namespace tether {
namespace {

/// Simulators send twenty a second.
constexpr Duration kClockPatience = std::chrono::seconds{1};

double number(const nlohmann::json& twist, const char* name, double limit) {
  if (twist.is_object() && twist.contains(name) && twist[name].is_number()) {
    const auto x = twist[name].get<double>();
    if (std::isfinite(x) && std::abs(x) <= limit) return x;
  }
  throw UsageError(
      "a twist has to be {\"v_mps\": V, \"omega_radps\": W} with V in [-10, 10], W in [-5, 5]");
}

}  // namespace

void HandDrive::hear(const clock_t& clock, Instant now) {
  if (clock_ && clock_->run != clock.run) pose_utime_ = -1;
  clock_ = clock;
  clock_at_ = now;
}

void HandDrive::hear(const pose_t& pose) {
  if (clock_ && pose.run == clock_->run) pose_utime_ = std::max(pose_utime_, pose.utime);
}

twist_t HandDrive::stamped(double v_mps, double omega_radps, Instant now) {
  twist_t twist{};
  const double gone_us = 1e6 * to_seconds(now - clock_at_) * clock_->rate;
  twist.utime = clock_->utime + std::llround(gone_us);
  twist.seq = seq_++;
  twist.run = clock_->run;
  twist.pose_utime = pose_utime_;
  twist.v_mps = v_mps;
  twist.omega_radps = omega_radps;
  return twist;
}

twist_t HandDrive::take(ClientId client, std::string_view json, Instant now) {
  const auto twist = try_parse_json(json);
  const double v_mps = number(twist, "v_mps", kFastest_mps);
  const double omega_radps = number(twist, "omega_radps", kFastest_radps);
  if (!clock_ || now - clock_at_ > kClockPatience) {
    throw UsageError("there is nothing to drive: no SIM/CLOCK was heard for a second");
  }
  if (is_held(now) && *driver_ != client) throw UsageError("another client is driving");
  driver_ = client;
  driven_at_ = now;
  zeros_ = kZeros;
  return stamped(v_mps, omega_radps, now);
}

std::optional<twist_t> HandDrive::tick(Instant now) {
  if (is_held(now) || zeros_ == 0 || !clock_) return std::nullopt;
  --zeros_;
  return stamped(0.0, 0.0, now);
}

}  // namespace tether
