#pragma once

#include <cstdint>
#include <vector>

namespace tether {

/// Information that a receiver of a message lacks without a newer one of its channel: value of
/// information as a way [m].
/// - pose_t: the way between the points 1 m ahead of both. A pose says nothing of speed, so until
///   the next one its receiver is taken to hold it.
/// - plan_t: the largest distance, within 1 s from the newer one's start and as long as both last,
///   between who follows one and who follows the other from the same place: plan divergence. If
///   the known one is over: infinity.
/// - twist_t: the same, both in force for 1 s.
/// 0 if the two are something else, or cannot be decoded.
double divergence_m(const std::vector<std::uint8_t>& newer, const std::vector<std::uint8_t>& known);

}  // namespace tether
