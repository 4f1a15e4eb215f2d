#pragma once

#include <cstdint>
#include <ctime>
#include <list>
#include <optional>
#include <thread>
#include <vector>

#include "common/node/event_loop.hpp"
#include "common/node/timer_queue.hpp"

namespace tether {

/// Real time (or slow motion): epoll with an absolute timerfd on CLOCK_BOOTTIME, so that periods
/// do not drift, no step of the wall clock is noticed, and the time that the machine is suspended
/// counts. SIGINT and SIGTERM end run() cleanly (they are blocked for the process from
/// construction on).
///
/// The run's clock is anchored once, at construction. With the wall clock as anchor, nodes of
/// several hosts that get the same `start_utime_us` agree on t = 0. The alternative is the host's
/// boot clock, with which a node that is restarted in the middle of a run joins at the right time,
/// whatever has become of the wall clock since.
class RealTimeLoop final : public EventLoop {
 public:
  /// `start_utime_us`: the wall-clock time (µs since 1970) of the run's t = 0.
  /// `speed`: run seconds per wall second, > 0. Below 1 is slow motion, for machines that cannot
  /// keep up; every deadline stretches with it, in all nodes of a run.
  /// `start_boot_ns`: the same time on this host's CLOCK_BOOTTIME, as another node's
  /// start_boot_ns() says; `start_utime_us` then only tells runs apart.
  explicit RealTimeLoop(std::int64_t start_utime_us, double speed = 1.0,
                        std::optional<std::int64_t> start_boot_ns = std::nullopt);
  ~RealTimeLoop() override;

  Instant now() const override;
  std::int64_t run_id() const override { return run_id_; }
  double rate() const override { return speed_; }
  void at(Instant when, Priority priority, Task task) override;
  void every(Instant first, Duration period, Priority priority, Task task) override;
  void add_fd(int fd, Task task) override;
  void remove_fd(int fd) override;
  void aside(std::function<void()> work, Task then) override;
  void stop() override { stopped_ = true; }
  std::uint64_t slips() const override { return slips_; }

  /// Largest lateness of any periodic task so far.
  Duration lateness_max() const { return lateness_max_; }

  /// How late the periodic tasks of t >= 0 have been, integrated over the time: at each instant,
  /// how long ago the earliest task was due that has not begun; s². A pause of D adds D²/2.
  double lateness_s2() const { return lateness_s2_; }

  /// t = 0 on this host's CLOCK_BOOTTIME.
  std::int64_t start_boot_ns() const { return start_boot_ns_; }

  /// Moves the clock so that now() is `now`, of the run `run_id`; for nodes that follow another
  /// node's clock, before they schedule anything.
  void set_now(Instant now, std::int64_t run_id);

  /// Runs until stop(), a termination signal, or `end`.
  void run_until(Instant end);
  void run() { run_until(Instant::max()); }

  /// The termination signal that ended run(), 0 if none did.
  int signal() const { return signal_; }

  /// The wall clock now, µs since 1970.
  static std::int64_t wall_utime_us();
  /// Another one at each start of a program, also of two at the same microsecond.
  static std::int64_t number_of_this_start();

 private:
  struct Descriptor {
    int fd;
    Task task;
  };
  void run_due_timers(Instant end);
  void note_lateness(Instant due, Instant now);
  void wait(Instant until);
  void arm(Instant until);
  void on_timer();
  std::int64_t wall_ns(Duration run_time) const;
  void read_signal();

  /// A task that aside() runs.
  struct Aside {
    int done_fd;  // becomes readable
    std::jthread thread;
  };

  TimerQueue timers_;
  std::vector<Descriptor> descriptors_;
  std::list<Aside> asides_;
  std::int64_t run_id_;
  double speed_;
  static constexpr std::int64_t kNotArmed = -1;
  std::int64_t armed_ns_ = kNotArmed;  // present setting of the timer; 0: never
  bool asleep_ = false;                // it was set to a time that had not come
  std::int64_t wake_lead_ns_ = 0;      // the timer is set earlier by this
  std::int64_t start_boot_ns_ = 0;
  int epoll_fd_ = -1;
  int timer_fd_ = -1;
  int signal_fd_ = -1;
  int signal_ = 0;
  bool stopped_ = false;
  std::uint64_t slips_ = 0;
  Duration lateness_max_{0};
  double lateness_s2_ = 0.0;
  Instant late_until_{};  ///< to where lateness_s2_ is integrated
};

}  // namespace tether
