#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/node/bus.hpp"
#include "common/node/real_time_loop.hpp"

namespace tether {

inline constexpr const char* kLoopChannel = "RUN/LOOP";
/// The counter of kLoopChannel that LoopReport publishes.
inline constexpr const char* kLatenessCounter = "loop.lateness_us_s";

/// Says on RUN/LOOP (counters_t, node: the program's name) how late a program's loop has been so
/// far since t = 0: `loop.slips`, and RealTimeLoop::lateness_s2() in µs·s. A message
/// that a program sends while its loop is late is older by as much, so this number divided by the
/// duration of the run is the program's share of the mean age of its messages. `loop` and the buses
/// must outlive it.
class LoopReport {
 public:
  LoopReport(RealTimeLoop& loop, std::vector<Bus*> buses, std::string program);
  LoopReport(const LoopReport&) = delete;
  LoopReport& operator=(const LoopReport&) = delete;

  void publish_now();

 private:
  RealTimeLoop& loop_;
  std::vector<Bus*> buses_;
  std::string program_;
  std::int64_t seq_ = 0;
};

}  // namespace tether
