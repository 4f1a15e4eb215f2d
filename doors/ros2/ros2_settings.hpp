#pragma once

#include "common/scenario/section.hpp"

namespace tether {

/// [ros2]: the door to ROS 2 (controller.ros2 = true).
struct Ros2Settings {
  /// Hosts whose ROS 2 nodes are found: this one, or all that multicast reaches.
  enum class Range { localhost, subnet };
  int domain = 0;  ///< ROS_DOMAIN_ID
  Range range = Range::localhost;
  bool sim_time = false;           ///< stamps are the run's time, and /clock is published
  double max_age_s = 0.5;          ///< maximum age of a stamped command at its arrival
  double answer_patience_s = 1.0;  ///< simulated time: maximum wait for an answer, wall clock
};

/// It has an effect with controller.ros2 only, which scenarios/sections.cpp says.
ScenarioSection ros2_section();

}  // namespace tether
