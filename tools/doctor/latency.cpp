#include "tools/doctor/latency.hpp"

#include <fcntl.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "common/node/real_time_loop.hpp"

namespace tether {
namespace {

constexpr Duration kWakeUp = std::chrono::milliseconds{1};
constexpr int kBridgePriority = 50;  // tether-can-bridge.service

/// Passes over more memory than a processor caches.
void keep_processor_busy(const std::atomic<bool>& done) {
  std::vector<std::uint64_t> memory(std::size_t{4} << 20);
  for (std::uint64_t pass = 1; !done; ++pass) {
    for (std::uint64_t& word : memory) word = word * 6364136223846793005U + pass;
  }
}

void keep_disk_busy(const std::atomic<bool>& done) {
  std::string name = (std::filesystem::temp_directory_path() / "tether-doctor-XXXXXX").string();
  const int fd = mkostemp(name.data(), O_CLOEXEC);
  if (fd < 0) return;
  unlink(name.c_str());
  const std::vector<char> block(std::size_t{1} << 20, 'x');
  while (!done) {
    const bool written = pwrite(fd, block.data(), block.size(), 0) > 0 && fdatasync(fd) == 0;
    if (!written) break;
  }
  close(fd);
}

/// Work of others while it lives. It is not in real time: threads are made before that is asked
/// for.
class Load {
 public:
  Load() {
    const unsigned processors = std::max(1U, std::thread::hardware_concurrency());
    for (unsigned i = 0; i < processors; ++i) {
      threads_.emplace_back([this] { keep_processor_busy(done_); });
    }
    threads_.emplace_back([this] { keep_disk_busy(done_); });
  }
  ~Load() { done_ = true; }

 private:
  std::atomic<bool> done_{false};
  std::vector<std::jthread> threads_;  // joined before done_ ends
};

/// The bridge's priority and locked memory while it lives, if both are granted.
class BridgePriority {
 public:
  BridgePriority() {
    const sched_param urgent{.sched_priority = kBridgePriority};
    granted_ = sched_setscheduler(0, SCHED_FIFO, &urgent) == 0;
    granted_ = mlockall(MCL_CURRENT | MCL_FUTURE) == 0 && granted_;
  }
  ~BridgePriority() {
    const sched_param usual{};
    sched_setscheduler(0, SCHED_OTHER, &usual);
    munlockall();
  }
  BridgePriority(const BridgePriority&) = delete;
  BridgePriority& operator=(const BridgePriority&) = delete;

  bool granted() const { return granted_; }

 private:
  bool granted_ = false;
};

}  // namespace

Latency measure_latency(Duration time) {
  RealTimeLoop loop(RealTimeLoop::wall_utime_us());  // threads inherit its blocked signals
  std::vector<double> late_ms;
  late_ms.reserve(static_cast<std::size_t>(time / kWakeUp) + 1);
  Latency found;
  const Instant start = loop.now();
  {
    const Load load;
    const BridgePriority priority;
    found.is_realtime = priority.granted();
    loop.every(start + kWakeUp, kWakeUp, Priority::node, [&](Instant scheduled) {
      late_ms.push_back(to_milliseconds(loop.now() - scheduled));
    });
    loop.run_until(start + time);
  }
  found.seconds = to_seconds(loop.now() - start);
  found.wakeups = static_cast<std::int64_t>(late_ms.size());
  if (late_ms.empty()) return found;
  std::sort(late_ms.begin(), late_ms.end());
  found.worst_ms = late_ms.back();
  found.p999_ms = late_ms[(late_ms.size() - 1) * 999 / 1000];
  return found;
}

}  // namespace tether
