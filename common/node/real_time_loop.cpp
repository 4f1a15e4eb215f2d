#include "common/node/real_time_loop.hpp"

#include <pthread.h>
#include <sched.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <csignal>
#include <utility>

#include "common/base/errors.hpp"

namespace tether {
namespace {

constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;

/// A program may run with a real-time priority (chrt). Its loop needs that; what works beside the
/// loop does not, and would take turns of 100 ms with it where they share a processor.
void give_up_priority() {
  const sched_param none{};
  pthread_setschedparam(pthread_self(), SCHED_OTHER, &none);
}

std::int64_t read_clock_ns(clockid_t id) {
  timespec t{};
  check_system_call("reading the clock", clock_gettime(id, &t));
  return t.tv_sec * kNanosecondsPerSecond + t.tv_nsec;
}

/// Offset from the wall clock to CLOCK_BOOTTIME. The two cannot be read at once: the best
/// of a few tries is one that was not interrupted.
std::int64_t wall_to_boot_ns() {
  std::int64_t best_gap_ns = INT64_MAX, best_ns = 0;
  for (int i = 0; i < 5; ++i) {
    const std::int64_t before_ns = read_clock_ns(CLOCK_BOOTTIME);
    const std::int64_t wall_ns = read_clock_ns(CLOCK_REALTIME);
    const std::int64_t gap_ns = read_clock_ns(CLOCK_BOOTTIME) - before_ns;
    if (gap_ns >= best_gap_ns) continue;
    best_gap_ns = gap_ns;
    best_ns = before_ns + gap_ns / 2 - wall_ns;
  }
  return best_ns;
}

void watch(int epoll_fd, int fd) {
  epoll_event event{};
  event.events = EPOLLIN;
  event.data.fd = fd;
  check_system_call("watching a file descriptor", epoll_ctl(epoll_fd, EPOLL_CTL_ADD, fd, &event));
}

}  // namespace

RealTimeLoop::RealTimeLoop(std::int64_t start_utime_us, double speed,
                           std::optional<std::int64_t> start_boot_ns)
    : run_id_(start_utime_us),
      speed_(speed),
      start_boot_ns_(start_boot_ns ? *start_boot_ns : start_utime_us * 1000 + wall_to_boot_ns()) {
  assert(speed > 0.0);

  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  struct sigaction hangup {};
  sigaction(SIGHUP, nullptr, &hangup);
  if (hangup.sa_handler != SIG_IGN) sigaddset(&signals, SIGHUP);  // not under nohup
  check_system_call("blocking signals", sigprocmask(SIG_BLOCK, &signals, nullptr));
  signal_fd_ =
      check_system_call("opening a signalfd", signalfd(-1, &signals, SFD_CLOEXEC | SFD_NONBLOCK));
  timer_fd_ = check_system_call("opening a timerfd",
                                timerfd_create(CLOCK_BOOTTIME, TFD_CLOEXEC | TFD_NONBLOCK));
  epoll_fd_ = check_system_call("opening an epoll", epoll_create1(EPOLL_CLOEXEC));
  watch(epoll_fd_, signal_fd_);
  watch(epoll_fd_, timer_fd_);
}

RealTimeLoop::~RealTimeLoop() {
  for (Aside& aside : asides_) {
    aside.thread.join();
    close(aside.done_fd);
  }
  close(epoll_fd_);
  close(timer_fd_);
  close(signal_fd_);
}

std::int64_t RealTimeLoop::wall_utime_us() { return read_clock_ns(CLOCK_REALTIME) / 1000; }

std::int64_t RealTimeLoop::number_of_this_start() {
  return wall_utime_us() * 1000 + getpid() % 1000;
}

Instant RealTimeLoop::now() const {
  const std::int64_t wall_ns = read_clock_ns(CLOCK_BOOTTIME) - start_boot_ns_;
  if (speed_ == 1.0) return Instant{Duration{wall_ns}};
  return Instant{Duration{std::llround(static_cast<double>(wall_ns) * speed_)}};
}

void RealTimeLoop::set_now(Instant now, std::int64_t run_id) {
  run_id_ = run_id;
  start_boot_ns_ = read_clock_ns(CLOCK_BOOTTIME) - wall_ns(now.time_since_epoch());
}

std::int64_t RealTimeLoop::wall_ns(Duration run_time) const {
  if (speed_ == 1.0) return run_time.count();
  return std::llround(static_cast<double>(run_time.count()) / speed_);
}

void RealTimeLoop::at(Instant when, Priority priority, Task task) {
  timers_.add(when, priority, std::move(task));
}

void RealTimeLoop::every(Instant first, Duration period, Priority priority, Task task) {
  timers_.add_periodic(TimerQueue::not_before(now(), first, period), period, priority,
                       std::move(task));
}

void RealTimeLoop::add_fd(int fd, Task task) {
  watch(epoll_fd_, fd);
  // An earlier descriptor of this number was closed without remove_fd(), or epoll had refused.
  std::erase_if(descriptors_, [fd](const Descriptor& d) { return d.fd == fd; });
  descriptors_.push_back({fd, std::move(task)});
}

void RealTimeLoop::remove_fd(int fd) {
  epoll_ctl(epoll_fd_, EPOLL_CTL_DEL, fd, nullptr);
  std::erase_if(descriptors_, [fd](const Descriptor& d) { return d.fd == fd; });
}

void RealTimeLoop::aside(std::function<void()> work, Task then) {
  const int fd = check_system_call("opening an eventfd", eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  asides_.push_back({fd, std::jthread([fd, work = std::move(work)] {
                       give_up_priority();
                       work();
                       eventfd_write(fd, 1);
                     })});
  add_fd(fd, [this, ended = std::prev(asides_.end()), then = std::move(then)](Instant now) {
    remove_fd(ended->done_fd);
    ended->thread.join();
    close(ended->done_fd);
    asides_.erase(ended);
    then(now);
  });
}

void RealTimeLoop::run_until(Instant end) {
  stopped_ = false;
  while (!stopped_ && now() < end) {
    run_due_timers(end);
    if (!stopped_) wait(std::min(end, timers_.next()));
  }
}

void RealTimeLoop::run_due_timers(Instant end) {
  // A burst is bounded so that a node that cannot keep up still reads its messages and signals.
  constexpr int kBurst = 100;
  for (int i = 0; i < kBurst && !stopped_ && !timers_.empty(); ++i) {
    const Instant due = timers_.next();
    const Instant t = now();
    if (due > t || due > end) return;
    if (const Duration period = timers_.next_period(); period > Duration{0}) {
      lateness_max_ = std::max(lateness_max_, t - due);
      if (t - due > period) ++slips_;
      note_lateness(due, t);
    }
    timers_.run_next();
  }
}

void RealTimeLoop::note_lateness(Instant due, Instant now) {
  if (due < kStart) return;
  const double from_s = to_seconds(std::max(due, late_until_) - due);
  const double to_s = to_seconds(now - due);
  if (to_s > from_s) lateness_s2_ += 0.5 * (to_s * to_s - from_s * from_s);
  late_until_ = now;
}

void RealTimeLoop::wait(Instant until) {
  arm(until);
  std::array<epoll_event, 16> events{};
  const int count = epoll_wait(epoll_fd_, events.data(), static_cast<int>(events.size()), -1);
  if (count < 0 && errno == EINTR) return;
  check_system_call("waiting for events", count);
  for (int i = 0; i < count && !stopped_; ++i) {
    const int fd = events[static_cast<std::size_t>(i)].data.fd;
    if (fd == signal_fd_) read_signal();
    // The timerfd needs no read: arming it again clears it.
    if (fd == timer_fd_) on_timer();
    const auto found = std::find_if(descriptors_.begin(), descriptors_.end(),
                                    [fd](const Descriptor& d) { return d.fd == fd; });
    if (found == descriptors_.end()) continue;
    const Task task = found->task;  // a copy, for it may add or remove descriptors
    task(now());
  }
}

void RealTimeLoop::on_timer() {
  // Follows the lower quartile of how long the kernel takes to wake this process. The timer is set
  // earlier by that much, so that the wait ends on time. A process that is woken too early waits
  // for the rest without sleeping.
  constexpr std::int64_t kStep_ns = 500, kMax_ns = 100'000;
  const std::int64_t took_ns = read_clock_ns(CLOCK_BOOTTIME) - armed_ns_;
  armed_ns_ = kNotArmed;
  if (!asleep_) return;
  wake_lead_ns_ += took_ns > wake_lead_ns_ ? kStep_ns : -3 * kStep_ns;
  wake_lead_ns_ = std::clamp<std::int64_t>(wake_lead_ns_, 0, kMax_ns);
}

void RealTimeLoop::arm(Instant until) {
  std::int64_t ns = 0;  // never
  if (until != Instant::max()) {
    // An absolute time of zero would disarm the timer; one nanosecond is as much in the past.
    ns = std::max<std::int64_t>(1,
                                wall_ns(until.time_since_epoch()) + start_boot_ns_ - wake_lead_ns_);
  }
  if (ns == armed_ns_) return;
  itimerspec spec{};
  spec.it_value.tv_sec = ns / kNanosecondsPerSecond;
  spec.it_value.tv_nsec = ns % kNanosecondsPerSecond;
  check_system_call("arming the timer",
                    timerfd_settime(timer_fd_, TFD_TIMER_ABSTIME, &spec, nullptr));
  armed_ns_ = ns;
  asleep_ = ns > read_clock_ns(CLOCK_BOOTTIME);
}

void RealTimeLoop::read_signal() {
  signalfd_siginfo info{};
  if (read(signal_fd_, &info, sizeof info) == sizeof info) {
    signal_ = static_cast<int>(info.ssi_signo);
    stopped_ = true;
  }
}

}  // namespace tether
