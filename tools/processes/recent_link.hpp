#pragma once

#include <cstdint>
#include <deque>
#include <limits>
#include <tether/link_report_t.hpp>

namespace tether {

/// Statistics of a direction of the relay over the last seconds: its reports count since its start.
/// Pure.
class RecentLink {
 public:
  static constexpr double kWindow_s = 10.0;  ///< a few messages, where one is sent a second

  struct Seen {
    double prr = std::numeric_limits<double>::quiet_NaN();       ///< NaN: nothing was sent
    double delay_ms = std::numeric_limits<double>::quiet_NaN();  ///< mean; NaN: nothing arrived
    double per_s = 0.0;                                          ///< messages heard
  };

  /// The newest report at `t_s`, which rises, and how many messages have been heard so far. A
  /// restarted relay resets them.
  void add(double t_s, const link_report_t& report, std::int64_t heard);
  Seen seen() const;

 private:
  struct Count {
    double t_s;
    std::int64_t offered, missing, delivered, heard;
    double delays_ms;  ///< their sum
  };
  std::deque<Count> counts_;
};

}  // namespace tether
