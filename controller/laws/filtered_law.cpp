#include "controller/laws/filtered_law.hpp"

#include <utility>

#include "controller/laws/tracking_law.hpp"

namespace tether {
FilteredLaw::FilteredLaw(std::unique_ptr<Law> law, const LawContext& context)
    : law_(std::move(law)),
      filter_(context.settings.get<ControllerSettings>().ekf, {},
              model_of(context.settings).limits(),
              context.settings.get<VehicleSettings>().start_pose()),
      wheels_(context.settings.get<VehicleSettings>().start_pose()),
      delay_(DelayEstimate::kFew),
      sensor_latency_(
          from_seconds(context.settings.get<ControllerSettings>().sensor_latency_ms * 1e-3)) {}

/// By what is in force: what the wheels last did; without odometry, what was sent.
template <class Vehicle>
void FilteredLaw::move(Instant at, Instant until, Vehicle& vehicle) const {
  Twist in_force;
  if (const auto done = wheels_.twist_before(at)) {
    vehicle.advance(*done, to_seconds(until - at));
    return;
  }
  const Duration delay = delay_.median();
  for (const SentTwist& sent : sent_) {
    const Instant from = sent.when + delay;
    if (from >= until) break;
    if (from > at) {
      vehicle.advance(in_force, to_seconds(from - at));
      at = from;
    }
    in_force = sent.twist;
  }
  if (until > at) vehicle.advance(in_force, to_seconds(until - at));
}

void FilteredLaw::on_pose(const SeenPose& seen) {
  delay_.add(seen.arrival - seen.stamp - sensor_latency_);
  const auto by_twists = [this](Instant from, Instant until, auto& f) { move(from, until, f); };
  wheels_.use(at_.value_or(seen.stamp), seen.stamp, filter_, by_twists);
  at_ = seen.stamp;
  wheels_.forget(*at_);
  while (sent_.size() > 1 && sent_[1].when + delay_.median() < seen.stamp) sent_.pop_front();
  filter_.update(seen.pose);
  estimate_ = seen;
  estimate_->pose = filter_.state().pose;
  law_->on_pose(*estimate_);
}

LawOutput FilteredLaw::decide(Instant now, const SeenPose* newest) {
  if (newest == nullptr) return remember(now, law_->decide(now, nullptr));
  SeenPose seen = *estimate_;
  if (const auto stamp = wheels_.newest_after(seen.stamp)) {
    PoseFilter ahead = filter_;
    wheels_.use(seen.stamp, *stamp, ahead,
                [this](Instant from, Instant until, auto& f) { move(from, until, f); });
    seen.stamp = *stamp;
    seen.pose = ahead.state().pose;
    seen.rolling = wheels_.twist_before(*stamp);
  }
  return remember(now, law_->decide(now, &seen));
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
