#pragma once

#include <memory>
#include <optional>

#include "controller/laws/law.hpp"
#include "controller/laws/sent_twist_filter.hpp"
#include "controller/laws/wheel_readings.hpp"

namespace tether {

/// A law that sends twists, behind a SentTwistFilter: it gets each pose as the filter estimates it.
/// Which of the sent twists the vehicle follows is estimated with it. Where the vehicle sends it,
/// the filter moves by what the wheels rolled, beyond the newest pose too, so that the law gets the
/// pose of the newest odometry. Adaptation would take losses for errors of the drive, and is not
/// done.
class FilteredLaw final : public Law {
 public:
  FilteredLaw(std::unique_ptr<Law> law, const LawContext& context);

  void on_pose(const SeenPose& seen) override;
  void on_odometry(const SeenOdometry& seen) override {
    wheels_.add(seen.stamp, seen.reckoning, seen.twist);
  }
  LawOutput decide(Instant now, const SeenPose* newest) override;
  LawOutput stop(Instant now) override;
  void reset() override { law_->reset(); }
  void set_look_ahead(double tau_s) override { law_->set_look_ahead(tau_s); }
  LawErrors errors() const override { return law_->errors(); }
  void list_counters(CounterList& out) const override;

 private:
  LawOutput remember(Instant now, LawOutput output);

  std::unique_ptr<Law> law_;
  SentTwistFilter filter_;
  WheelReadings wheels_;
  Duration sensor_latency_;
  std::optional<Instant> at_;         ///< time of the filter's estimate
  std::optional<SeenPose> estimate_;  ///< at the newest pose
};

}  // namespace tether
