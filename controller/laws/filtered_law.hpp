#pragma once

#include <deque>
#include <memory>
#include <optional>

#include "controller/laws/law.hpp"
#include "controller/laws/network_estimate.hpp"
#include "controller/laws/pose_filter.hpp"
#include "controller/laws/wheel_readings.hpp"

namespace tether {

/// A law that sends twists, behind a PoseFilter: it gets each pose as the filter estimates it. The
/// filter moves by the twists that were sent, each in force from the median delay of the last poses
/// after it was sent until the next takes over, as if none were lost. What is lost it does not
/// know, so at a PRR far from 1 its motion is wrong, and poses that say so may be gated: then plans
/// are better, or odometry. Where the vehicle sends it, the filter moves by what the wheels rolled,
/// beyond the newest pose too, so that the law gets the pose of the newest odometry. Adaptation
/// would take losses for errors of the drive, and is not done.
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
  struct SentTwist {
    Instant when;
    Twist twist;
  };
  LawOutput remember(Instant now, LawOutput output);
  template <class Vehicle>
  void move(Instant at, Instant until, Vehicle& vehicle) const;

  std::unique_ptr<Law> law_;
  PoseFilter filter_;
  WheelReadings wheels_;
  DelayEstimate delay_;
  Duration sensor_latency_;
  std::optional<Instant> at_;         ///< time of the filter's estimate
  std::optional<SeenPose> estimate_;  ///< at the newest pose
  std::deque<SentTwist> sent_;        ///< the first is in force at at_
};

}  // namespace tether
