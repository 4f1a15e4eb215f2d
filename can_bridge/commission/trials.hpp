#pragma once

#include <array>

namespace tether {

/// Trials of `tether can commission` with each drive, one after the other, each from standstill.
enum class Trial {
  feedback,    ///< velocity against position against setpoint
  quick_stop,  ///< deceleration
  silence,     ///< without anything, as after kill -9 of the bridge or a pulled plug
  heartbeat,   ///< without the bridge's heartbeat only
  setpoints,   ///< without RPDOs only
  sync,        ///< without SYNC only
};

inline constexpr std::array kTrials{Trial::feedback,  Trial::quick_stop, Trial::silence,
                                    Trial::heartbeat, Trial::setpoints,  Trial::sync};

/// "feedback", "quick stop", "nothing sent", "heartbeat withheld" …
const char* trial_name(Trial trial);

}  // namespace tether
