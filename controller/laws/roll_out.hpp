#pragma once

#include <cstddef>
#include <span>

#include "common/path/reference_path.hpp"
#include "common/vehicle/motion_model.hpp"
#include "controller/laws/tracking_feedback.hpp"

namespace tether {

/// A vehicle that is moved along its path on a model, step by step, by the feedback. What it is
/// made of must outlive it.
class RollOut {
 public:
  /// From `state`. `path`: where it is then and after each step, one point more than steps.
  RollOut(const MotionModel& model, const TrackingFeedback& feedback,
          std::span<const PathPoint> path, const MotionModel::State& state, double step_s)
      : model_(model),
        feedback_(feedback),
        path_(path),
        state_(state),
        heading_(Heading::of(state.pose.yaw_rad)),
        step_s_(step_s) {}

  /// Moves on by a step with what the wheels can do of `wish`, or without one of the feedback's: of
  /// the errors at the step's beginning, with the path's own twist at its middle. Returns the
  /// command that makes the model's vehicle do so.
  Twist step(const Twist* wish = nullptr);

  std::size_t steps() const { return steps_; }  ///< so far
  const MotionModel::State& state() const { return state_; }
  const PathPoint& reference() const { return path_[steps_]; }

 private:
  Twist feedback_wish() const;

  const MotionModel& model_;
  const TrackingFeedback& feedback_;
  std::span<const PathPoint> path_;
  MotionModel::State state_;
  Heading heading_;
  double step_s_;
  std::size_t steps_ = 0;
};

}  // namespace tether
