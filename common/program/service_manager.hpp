#pragma once

#include <string>

#include "common/node/event_loop.hpp"

namespace tether {

/// How a program stands with the service manager that started it (systemd: sd_notify(3)); of one
/// that was started otherwise, nothing happens. A unit with Type=notify is up when the program can
/// work, not when it has begun; one with WatchdogSec= is ended and restarted when the loop that
/// steers no longer turns, for it is this loop that answers, twice in each watchdog's time.
class ServiceManager {
 public:
  /// From here on the watchdog is answered. `loop` must outlive this.
  explicit ServiceManager(EventLoop& loop);

  /// Current activity, for `systemctl status`, before it is ready.
  void status(const std::string& text);
  void ready(const std::string& text);
  void stopping();
};

/// Lets the watchdog wait for `limit` while it exists: around a call that may block the loop.
class LongCall {
 public:
  explicit LongCall(Duration limit);
  ~LongCall();
  LongCall(const LongCall&) = delete;
  LongCall& operator=(const LongCall&) = delete;
};

/// Keeps all memory, also that to come, from being paged out, so that no setpoint waits for a disk.
/// Throws UsageError that says which right is missing.
void lock_memory();

}  // namespace tether
