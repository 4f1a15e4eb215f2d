#include "tools/gym/given_law.hpp"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <utility>

#include "controller/laws/tracking_feedback.hpp"

namespace tether {

GivenLaw::GivenLaw(LawContext context, bool plans)
    : context_(std::move(context)),
      plans_(plans),
      sensor_latency_(
          from_seconds(context_.settings.get<ControllerSettings>().sensor_latency_ms * 1e-3)),
      delay_(DelayEstimate::kFew) {}

void GivenLaw::give(std::span<const double> twists) {
  given_.clear();
  for (std::size_t i = 0; i + 1 < twists.size(); i += 2) {
    given_.push_back({twists[i], twists[i + 1]});
  }
}

void GivenLaw::on_pose(const SeenPose& seen) {
  delay_.add(seen.arrival - seen.stamp - sensor_latency_);
  if (seen.plan_id && *seen.plan_id < static_cast<std::int64_t>(decided_.size())) {
    acknowledged_ = decided_[static_cast<std::size_t>(*seen.plan_id)];
  }
}

LawOutput GivenLaw::decide(Instant now, const SeenPose* newest) {
  errors_ = errors_to(
      newest == nullptr ? context_.settings.get<VehicleSettings>().start_pose() : newest->pose,
      context_.path->at(to_seconds(now)));
  if (!plans_) return given_.front();
  return plan(now, std::move(given_));
}

LawOutput GivenLaw::stop(Instant now) {
  if (!plans_) return Twist{};
  return plan(now, {Twist{}});
}

LawOutput GivenLaw::plan(Instant now, std::vector<Twist> twists) {
  Plan plan;
  plan.name.id = static_cast<std::int64_t>(decided_.size());
  decided_.push_back(now);
  plan.start =
      std::chrono::ceil<std::chrono::microseconds>(std::max(now + delay_.longest(), kStart));
  plan.step = context_.settings.get<ControllerSettings>().plan_step();
  plan.twists = std::move(twists);
  return plan;
}

void GivenLaw::list_counters(CounterList& out) const {
  if (plans_) out.emplace_back("plan.made", static_cast<std::int64_t>(decided_.size()));
}

}  // namespace tether
