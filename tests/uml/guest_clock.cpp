// For LD_PRELOAD into User-Mode Linux 6.1: what time is in the guest of with_can.sh.
//   While the guest works, its time is a quarter of the processor time that it took: while the host
// gives the processor to others the guest stands still, and sees no pause that its programs did not
// make. A quarter, because page faults and system calls take many times as long as on a machine: to
// start a program would hold up all others for tenths of a second.
//   While the guest waits, its time jumps to the timer that it waits for: nothing reaches it from
// outside, so nothing could come before.
// So what is tested is what programs do with time, not what else the host has to do.

#include <dlfcn.h>
#include <signal.h>
#include <sys/wait.h>
#include <time.h>

namespace {

constexpr long long kSecond = 1'000'000'000;
constexpr long long kFaster = 4;
constexpr long long kGlance = 50'000;  // below it, the host's time is near enough and cheaper

template <class Function>
Function* libc(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

long long host_time(clockid_t clock) {
  static auto* const kGet = libc<int(clockid_t, timespec*)>("clock_gettime");
  timespec now{};
  return kGet(clock, &now) == 0 ? now.tv_sec * kSecond + now.tv_nsec : 0;
}

pid_t running = 0;  // the process of the guest that ran last

// Since the call before: of the guest's kernel, and of its process that runs if it is still the
// same.
long long processor_time() {
  static long long kernel_ns = 0;
  static long long process_ns = 0;
  static pid_t process = 0;
  const long long kernel_now = host_time(CLOCK_PROCESS_CPUTIME_ID);
  const auto its_clock = static_cast<clockid_t>((~static_cast<unsigned>(running) << 3) | 2);
  const long long process_now = host_time(its_clock);  // clock_getcpuclockid(3), without looking
  const long long taken =
      kernel_now - kernel_ns + (process == running ? process_now - process_ns : 0);
  kernel_ns = kernel_now;
  process_ns = process_now;
  process = running;
  return taken;
}

// One thread alone looks, but a signal's handler may look within a look: what that adds twice is a
// glance, and the guest's time never goes back.
long long guest_ns = 0;
long long host_ns = 0;
long long glances_ns = 0;  // since processor_time() was asked
long long timer_ns = 0;    // when the guest's one timer ends, 0 for never
timer_t guest_timer;

long long add_to_guest(long long step) {
  return __atomic_add_fetch(&guest_ns, step, __ATOMIC_SEQ_CST);
}

long long guest_now() {
  const long long now = host_time(CLOCK_MONOTONIC);
  if (guest_ns == 0) guest_ns = host_ns = now;
  const long long passed = now - __atomic_exchange_n(&host_ns, now, __ATOMIC_SEQ_CST);
  if (passed <= kGlance) {
    const long long step = passed < 0 ? 0 : passed;
    glances_ns += step;
    return add_to_guest(step / kFaster);
  }
  const long long worked = processor_time() - glances_ns;
  glances_ns = 0;
  return add_to_guest((worked < kGlance ? kGlance : worked < passed ? worked : passed) / kFaster);
}

int set_timer(timer_t timer, const itimerspec* value, itimerspec* old) {
  static auto* const kSet =
      libc<int(timer_t, int, const itimerspec*, itimerspec*)>("timer_settime");
  return kSet(timer, 0, value, old);
}

}  // namespace

extern "C" int clock_gettime(clockid_t clock, timespec* result) noexcept {
  static auto* const kGet = libc<int(clockid_t, timespec*)>("clock_gettime");
  if (clock != CLOCK_MONOTONIC) return kGet(clock, result);
  const long long now = guest_now();
  *result = {.tv_sec = now / kSecond, .tv_nsec = now % kSecond};
  return 0;
}

// Always from now on, and once: User-Mode Linux sets no other. It may end early by the guest's
// time; the guest then sets it to the rest.
extern "C" int timer_settime(timer_t timer, int /*flags*/, const itimerspec* value,
                             itimerspec* old) noexcept {
  const long long length = value->it_value.tv_sec * kSecond + value->it_value.tv_nsec;
  guest_timer = timer;
  timer_ns = length == 0 ? 0 : guest_now() + length;
  return set_timer(timer, value, old);
}

extern "C" int sigsuspend(const sigset_t* mask) {
  static auto* const kSuspend = libc<int(const sigset_t*)>("sigsuspend");
  if (timer_ns != 0) {
    if (const long long wait = timer_ns - guest_now(); wait > 0) add_to_guest(wait);
    const itimerspec now{.it_interval = {}, .it_value = {.tv_sec = 0, .tv_nsec = 1}};
    set_timer(guest_timer, &now, nullptr);
  }
  return kSuspend(mask);
}

extern "C" pid_t waitpid(pid_t pid, int* status, int options) {
  static auto* const kWait = libc<pid_t(pid_t, int*, int)>("waitpid");
  running = pid;
  return kWait(pid, status, options);
}
