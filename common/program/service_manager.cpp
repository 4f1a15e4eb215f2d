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

}  // namespace

ServiceManager::ServiceManager(EventLoop& loop) {
  std::uint64_t watchdog_us = 0;
  if (sd_watchdog_enabled(0, &watchdog_us) <= 0) return;
  const Duration half = std::chrono::microseconds{watchdog_us / 2};
  loop.every(loop.now() + half, half, Priority::observer, [](Instant) { tell("WATCHDOG=1"); });
}

void ServiceManager::status(const std::string& text) { tell("STATUS=" + text); }

void ServiceManager::ready(const std::string& text) { tell("READY=1\nSTATUS=" + text); }

void ServiceManager::stopping() { tell("STOPPING=1"); }

void lock_memory() {
  if (mlockall(MCL_CURRENT | MCL_FUTURE) == 0) return;
  throw UsageError(
      fmt::format("--lock-memory: {}; a unit needs LimitMEMLOCK=infinity, a shell `ulimit -l "
                  "unlimited`",
                  std::generic_category().message(errno)));
}

}  // namespace tether
