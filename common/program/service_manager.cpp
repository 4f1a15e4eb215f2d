#include "common/program/service_manager.hpp"

#include <fmt/format.h>
#include <sys/mman.h>
#include <systemd/sd-daemon.h>

#include <cerrno>
#include <system_error>

#include "common/base/errors.hpp"

namespace tether {
namespace {

void tell(const std::string& state) { sd_notify(0, state.c_str()); }

/// The unit's, or 0 without one for this process.
std::uint64_t watchdog_time_us() {
  std::uint64_t time_us = 0;
  return sd_watchdog_enabled(0, &time_us) > 0 ? time_us : 0;
}

void set_watchdog(std::uint64_t time_us) { tell(fmt::format("WATCHDOG_USEC={}", time_us)); }

}  // namespace

ServiceManager::ServiceManager(EventLoop& loop) {
  const std::uint64_t watchdog_us = watchdog_time_us();
  if (watchdog_us == 0) return;
  const Duration half = std::chrono::microseconds{watchdog_us / 2};
  loop.every(loop.now() + half, half, Priority::observer, [](Instant) { tell("WATCHDOG=1"); });
}

void ServiceManager::status(const std::string& text) { tell("STATUS=" + text); }

void ServiceManager::ready(const std::string& text) { tell("READY=1\nSTATUS=" + text); }

void ServiceManager::stopping() { tell("STOPPING=1"); }

LongCall::LongCall(Duration limit) {
  const auto limit_us = std::chrono::duration_cast<std::chrono::microseconds>(limit).count();
  if (watchdog_time_us() != 0) set_watchdog(static_cast<std::uint64_t>(limit_us));
}

LongCall::~LongCall() {
  if (const std::uint64_t time_us = watchdog_time_us(); time_us != 0) set_watchdog(time_us);
}

void lock_memory() {
  if (mlockall(MCL_CURRENT | MCL_FUTURE) == 0) return;
  throw UsageError(
      fmt::format("--lock-memory: {}; a unit needs LimitMEMLOCK=infinity, a shell `ulimit -l "
                  "unlimited`",
                  std::generic_category().message(errno)));
}

}  // namespace tether
