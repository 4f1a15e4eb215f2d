#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "common/base/time.hpp"
#include "common/path/reference_path.hpp"

namespace tether {

/// The points of a path at times that are steps apart, each asked of it once: most of what a plan
/// looks at the one before it has looked at, too. They are the path's own, to the bit.
class PathSamples {
 public:
  /// `step` > 0.
  PathSamples(std::shared_ptr<const ReferencePath> path, Duration step)
      : path_(std::move(path)), step_(step) {}

  /// Points at `start`, `start` + step, …: `count` of them, until the next call. What was before
  /// `start` is forgotten.
  std::span<const PathPoint> from(Instant start, std::size_t count) {
    const Duration later = start - first_;
    const Duration known = step_ * static_cast<std::int64_t>(points_.size());
    if (later < Duration{0} || later > known || later % step_ != Duration{0}) {
      points_.clear();
    } else {
      points_.erase(points_.begin(), points_.begin() + later / step_);
    }
    first_ = start;
    while (points_.size() < count) {
      points_.push_back(
          path_->at(to_seconds(start + step_ * static_cast<std::int64_t>(points_.size()))));
    }
    return {points_.data(), count};
  }

 private:
  std::shared_ptr<const ReferencePath> path_;
  Duration step_;
  Instant first_ = kStart;
  std::vector<PathPoint> points_;
};

}  // namespace tether
