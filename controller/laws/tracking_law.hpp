#pragma once

#include <deque>
#include <memory>

#include "common/vehicle/motion_model.hpp"
#include "controller/laws/law.hpp"
#include "controller/laws/network_estimate.hpp"
#include "controller/laws/tracking_feedback.hpp"

namespace tether {

/// The vehicle as controller.model.* and the scenario's vehicle have it.
MotionModel model_of(const LawSettings& settings);

/// Feedforward and feedback (TrackingFeedback) on the newest pose as if it were the present one.
class TrackingLaw final : public Law {
 public:
  explicit TrackingLaw(const LawContext& context);

  LawOutput decide(Instant now, const SeenPose* newest) override;
  LawErrors errors() const override { return errors_; }

 private:
  std::shared_ptr<const ReferencePath> path_;
  TrackingFeedback feedback_;
  LawErrors errors_;
};

/// The same on the pose that the vehicle is predicted to have when the command arrives: from the
/// newest pose, through the commands sent. Each command is in force from its arrival, one delay of
/// the downlink after it was sent, until that of the next. The delay is assumed to be the median of
/// the last poses'. All commands are assumed to arrive: with much loss, the prediction is wrong
/// (PredictiveLaw mends that). Behind a filter that hears the wheels' odometry, the prediction
/// begins with what the wheels do, and each later command is mixed in by the share of poses that
/// arrive: the expected command, if commands are lost as often.
class CompensatedTrackingLaw final : public Law {
 public:
  explicit CompensatedTrackingLaw(const LawContext& context);

  void on_pose(const SeenPose& seen) override;
  LawOutput decide(Instant now, const SeenPose* newest) override;
  LawOutput stop(Instant now) override;
  LawErrors errors() const override { return errors_; }

 private:
  struct SentTwist {
    Instant when;
    Twist twist;
  };
  void remember(Instant now, const Twist& twist);
  MotionModel::State predict(const SeenPose& seen, Instant until) const;

  std::shared_ptr<const ReferencePath> path_;
  MotionModel model_;
  TrackingFeedback feedback_;
  DelayEstimate delay_;
  ReceptionEstimate reception_{100};
  Duration sensor_latency_;
  std::deque<SentTwist> sent_;
  LawErrors errors_;
};

}  // namespace tether
