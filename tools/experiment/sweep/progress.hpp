#pragma once

#include <chrono>
#include <string>

#include "tools/experiment/sweep/sweep.hpp"

namespace tether {

/// "0.8 s", "42 s", "3 min 05 s", "2 h 07 min", "3 d 04 h".
std::string format_duration(double seconds);

/// "[=====>    ] 512/1000 runs, 7.9/s, 1 min 02 s to go, 2 failed".
std::string progress_text(const SweepProgress& progress);

/// Shows progress on stderr: on a terminal in place, else a line every half minute.
class ProgressBar {
 public:
  ProgressBar();
  void show(const SweepProgress& progress);
  void end();

 private:
  bool terminal_;
  bool any_ = false;
  std::chrono::steady_clock::time_point shown_;
};

}  // namespace tether
