#include "controller/laws/filtered_law.hpp"

#include <algorithm>
#include <utility>

#include "controller/laws/tracking_law.hpp"

namespace tether {
FilteredLaw::FilteredLaw(std::unique_ptr<Law> law, const LawContext& context)
    : law_(std::move(law)),
      filter_(context.settings, model_of(context.settings).limits()),
      wheels_(context.settings.get<VehicleSettings>().start_pose()),
      sensor_latency_(
          from_seconds(context.settings.get<ControllerSettings>().sensor_latency_ms * 1e-3)) {}

void FilteredLaw::on_pose(const SeenPose& seen) {
  filter_.hear(seen.seq, seen.arrival - seen.stamp - sensor_latency_);
  wheels_.use(at_.value_or(std::min(seen.stamp, kStart)), seen.stamp, filter_);
  at_ = seen.stamp;
  wheels_.forget(*at_);
  filter_.update(seen.pose);
  estimate_ = seen;
  estimate_->pose = filter_.mean().state().pose;
  law_->on_pose(*estimate_);
}

LawOutput FilteredLaw::decide(Instant now, const SeenPose* newest) {
  if (newest == nullptr) return remember(now, law_->decide(now, nullptr));
  SeenPose seen = *estimate_;
  if (const auto stamp = wheels_.newest_after(seen.stamp)) {
    SentTwistFilter ahead = filter_;
    wheels_.use(seen.stamp, *stamp, ahead);
    seen.stamp = *stamp;
    seen.pose = ahead.mean().state().pose;
    seen.rolling = wheels_.twist_before(*stamp);
  }
  return remember(now, law_->decide(now, &seen));
}

LawOutput FilteredLaw::stop(Instant now) { return remember(now, law_->stop(now)); }

LawOutput FilteredLaw::remember(Instant now, LawOutput output) {
  filter_.send(now, std::get<Twist>(output));
  return output;
}

void FilteredLaw::list_counters(CounterList& out) const {
  law_->list_counters(out);
  filter_.list_counters(out);
}

}  // namespace tether
