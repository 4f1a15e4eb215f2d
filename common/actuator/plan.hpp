#pragma once

#include <algorithm>
#include <cassert>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// Which plan: a session of a controller, and its number in it.
struct PlanName {
  std::int64_t session = -1;  ///< −1: none
  std::int64_t id = -1;       ///< −1: none

  bool operator==(const PlanName&) const = default;
};

/// How a plan reached the vehicle: through the relay's downlink, or handed over before departure.
enum class PlanSource { network, preload };

/// A plan_t: twists that follow each other in equal steps of time. Nothing in it is checked: see
/// PlanBuffer.
struct Plan {
  static constexpr std::int64_t kBasedOnNone = -1;
  static constexpr std::int64_t kBasedOnAny = -2;

  Instant stamp;                ///< stamp of its message
  std::optional<Instant> pose;  ///< when the pose was measured that it was predicted from
  std::int64_t seq = 0;
  PlanName name;
  std::int64_t based_on = kBasedOnAny;  ///< id of a plan of the same session, or one of the above
  /// Equal to based_on; or a later id: then the plan is based on any plan of this range that has
  /// settled.
  std::int64_t based_on_last = kBasedOnAny;
  Instant start;
  Duration step{};
  /// The plan has settled from here to its end: it predicts the vehicle where all settled plans of
  /// its session do, on the path.
  Instant settled = Instant::max();
  std::vector<Twist> twists;

  /// Whether it says to stand still all the time; an empty one says nothing.
  bool is_stop() const {
    return !twists.empty() && std::all_of(twists.begin(), twists.end(), stands_still);
  }

  /// When the last twist ends. `step` and the number of twists must be in their ranges.
  Instant end() const { return start + step * static_cast<std::int64_t>(twists.size()); }

  /// The twist in force at `t`: the first before the start, the last after the end. The plan must
  /// have a twist and step > 0.
  const Twist& at(Instant t) const {
    assert(!twists.empty() && step > Duration{0});
    return twists[static_cast<std::size_t>(number_at(t))];
  }
  /// When the twist in force at `t`, before the end, ends.
  Instant end_of_twist(Instant t) const { return start + step * (number_at(t) + 1); }

 private:
  std::int64_t number_at(Instant t) const {
    const auto last = static_cast<std::int64_t>(twists.size()) - 1;
    return std::clamp<std::int64_t>((t - start) / step, 0, last);
  }
};

}  // namespace tether
