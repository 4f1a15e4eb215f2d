#include "controller/laws/filtered_law.hpp"

#include <utility>

#include "controller/laws/tracking_law.hpp"

namespace tether {
namespace {

Pose2 start_of(const VehicleSettings& vehicle) {
  return {vehicle.start_x_m, vehicle.start_y_m, wrap_angle(vehicle.start_yaw_rad)};
}

}  // namespace

FilteredLaw::FilteredLaw(std::unique_ptr<Law> law, const LawContext& context)
    : law_(std::move(law)),
      filter_(context.settings.get<ControllerSettings>().ekf, {},
              model_of(context.settings).limits(),
              start_of(context.settings.get<VehicleSettings>())),
      delay_(DelayEstimate::kFew),
      sensor_latency_(
          from_seconds(context.settings.get<ControllerSettings>().sensor_latency_ms * 1e-3)) {}

void FilteredLaw::on_pose(const SeenPose& seen) {
  delay_.add(seen.arrival - seen.stamp - sensor_latency_);
  wheels_.use(at_.value_or(seen.stamp), seen.stamp, filter_,
              [this](Instant until) { move_to(until); });
  filter_.update(seen.pose);
  estimate_ = seen;
  estimate_->pose = filter_.state().pose;
  law_->on_pose(*estimate_);
}

void FilteredLaw::move_to(Instant stamp) {
  const Duration delay = delay_.median();
  Instant at = at_.value_or(stamp);
  Twist in_force;
  while (!sent_.empty() && sent_.front().when + delay < stamp) {
    const Instant from = sent_.front().when + delay;
    if (from > at) {
      filter_.advance(in_force, to_seconds(from - at));
      at = from;
    }
    in_force = sent_.front().twist;
    if (sent_.size() == 1 || sent_[1].when + delay >= stamp) break;
    sent_.pop_front();
  }
  if (stamp > at) filter_.advance(in_force, to_seconds(stamp - at));
  at_ = stamp;
}

LawOutput FilteredLaw::decide(Instant now, const SeenPose* newest) {
  return remember(now, law_->decide(now, newest == nullptr ? nullptr : &*estimate_));
}

LawOutput FilteredLaw::stop(Instant now) { return remember(now, law_->stop(now)); }

LawOutput FilteredLaw::remember(Instant now, LawOutput output) {
  constexpr std::size_t kMost = 100000;  // without poses for long
  sent_.push_back({now, std::get<Twist>(output)});
  if (sent_.size() > kMost) sent_.pop_front();
  return output;
}

void FilteredLaw::list_counters(CounterList& out) const {
  law_->list_counters(out);
  filter_.list_counters(out);
}

}  // namespace tether
