#include "controller/laws/pid_law.hpp"

#include <cmath>
#include <utility>

#include "common/path/controlled_point.hpp"

namespace tether {
namespace {

Pid make_pid(const PidGains& gains, double derivative_filter_s, bool angular) {
  return Pid({gains.p, gains.i, gains.d, gains.limit, derivative_filter_s, angular});
}

}  // namespace

PidLaw::PidLaw(const ControllerSettings& config, std::shared_ptr<const ReferencePath> path,
               double ahead_m)
    : path_(std::move(path)),
      ahead_m_(ahead_m),
      tau_s_(config.tau_s),
      wrap_heading_(config.wrap_heading),
      v_(make_pid(config.v, config.derivative_filter_s, false)),
      omega_(make_pid(config.omega, config.derivative_filter_s, config.wrap_heading)) {}

Twist PidLaw::step(const Pose2& pose, Instant now) {
  const PathPoint target = path_->at(to_seconds(now) + tau_s_);
  const Position point = point_ahead(pose, ahead_m_);
  const double dx_m = target.x_m - point.x_m;
  const double dy_m = target.y_m - point.y_m;
  errors_.heading_rad = std::atan2(dy_m, dx_m) - pose.yaw_rad;
  if (wrap_heading_) errors_.heading_rad = wrap_angle(errors_.heading_rad);
  errors_.distance_m = std::hypot(dx_m, dy_m);

  const double dt_s = to_seconds(now - last_);
  last_ = now;
  return {v_.step(errors_.distance_m, dt_s), omega_.step(errors_.heading_rad, dt_s)};
}

void PidLaw::reset() {
  v_.reset();
  omega_.reset();
}

LawKind pid_law() {
  return {.name = "pid",
          .steers_any_point = true,
          .looks_ahead = true,
          .keys = {},
          .make = [](const LawContext& context) -> std::unique_ptr<Law> {
            return std::make_unique<PidLaw>(context.settings.get<ControllerSettings>(),
                                            context.path, context.ahead_m);
          }};
}

}  // namespace tether
