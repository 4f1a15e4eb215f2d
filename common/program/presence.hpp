#pragma once

#include <optional>
#include <string>
#include <tether/presence_t.hpp>
#include <vector>

#include "common/bus/bus.hpp"
#include "common/loop/event_loop.hpp"

namespace tether {

inline constexpr const char* kPresenceChannel = "RUN/PRESENCE";
/// On the wall clock, whatever the run's rate.
inline constexpr Duration kPresencePeriod = std::chrono::milliseconds{250};

/// Says on RUN/PRESENCE that this program takes part in a live run, every kPresencePeriod while the
/// loop is alive. Others learn from it who shares their network, and that
/// a program hangs. `loop` and the buses must outlive it.
class Presence {
 public:
  Presence(EventLoop& loop, std::vector<Bus*> buses, const std::string& program,
           const std::string& vehicle);
  Presence(const Presence&) = delete;
  Presence& operator=(const Presence&) = delete;

  /// Publishes a presence now, before other messages or for a program that has just started, unless
  /// one was published within kLeastGap.
  void answer();

 private:
  static constexpr Duration kLeastGap = std::chrono::milliseconds{20};
  void publish_now();

  EventLoop& loop_;
  std::vector<Bus*> buses_;
  presence_t message_{};
  std::optional<Instant> published_;
};

/// This host's name, as presences have it.
std::string host_name();

}  // namespace tether
