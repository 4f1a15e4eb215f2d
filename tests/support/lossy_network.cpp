// A multicast network that loses, doubles, delays and thereby reorders datagrams, for LD_PRELOAD.
// TETHER_LOSSY is "SEED LOST DOUBLED DELAYED FILE": a seed, the probability of each fault, and a
// file of three 64-bit numbers, which count the faults of all programs. Both datagrams of a doubled
// one may be late.

#include <dlfcn.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <pthread.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <map>
#include <mutex>
#include <random>
#include <string>
#include <thread>

namespace {

using Clock = std::chrono::steady_clock;
using SendMessage = ssize_t(int, const msghdr*, int);
using SendTo = ssize_t(int, const void*, size_t, int, const sockaddr*, socklen_t);

template <class Function>
Function* libc(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

struct Datagram {
  int fd;
  int flags;
  sockaddr_in to;
  std::string bytes;

  void send() const {
    static auto* const kSend = libc<SendTo>("sendto");
    kSend(fd, bytes.data(), bytes.size(), flags, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  }
};

class Network {
 public:
  Network() {
    const char* const given = std::getenv("TETHER_LOSSY");
    char file[4096];
    unsigned long long seed = 0;
    if (given == nullptr || std::sscanf(given, "%llu %lf %lf %lf %4095s", &seed, &lost_, &doubled_,
                                        &delayed_, file) != 5) {
      std::fprintf(stderr, "lossy_network: TETHER_LOSSY is missing or wrong\n");
      std::abort();
    }
    // Another stream for each program of a run.
    random_.seed(seed * 1'000'003 + std::hash<std::string>{}(program_invocation_short_name));
    const int fd = open(file, O_RDWR | O_CLOEXEC);
    void* const room = mmap(nullptr, 24, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (room == MAP_FAILED) std::abort();
    counts_ = static_cast<std::atomic<std::uint64_t>*>(room);
    close(fd);
  }

  void take(Datagram datagram) {
    const std::lock_guard<std::mutex> lock{mutex_};
    if (happens(lost_, 0)) return;
    if (happens(doubled_, 1)) send_or_delay(datagram);
    send_or_delay(datagram);
  }

 private:
  bool happens(double probability, int count) {
    const bool yes = std::uniform_real_distribution<double>{0.0, 1.0}(random_) < probability;
    if (yes) ++counts_[count];
    return yes;
  }

  // Most by less than lockstep waits before it asks again, so that others overtake it; one in ten
  // by more, so that it comes after its copy.
  void send_or_delay(const Datagram& datagram) {
    if (!happens(delayed_, 2)) {
      datagram.send();
      return;
    }
    const bool long_after = std::uniform_int_distribution<int>{1, 10}(random_) == 1;
    std::uniform_int_distribution<int> us{100, long_after ? 400'000 : 15'000};
    late_.emplace(Clock::now() + std::chrono::microseconds{us(random_)}, datagram);
    if (!started_) start();
    changed_.notify_one();
  }

  void start() {
    started_ = true;
    sigset_t all;
    sigset_t before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);  // signals are for the program's own thread
    std::thread{[this] { send_late_ones(); }}.detach();
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
  }

  void send_late_ones() {
    std::unique_lock<std::mutex> lock{mutex_};
    while (true) {
      if (late_.empty()) {
        changed_.wait(lock);
      } else if (const auto due = late_.begin()->first; Clock::now() < due) {
        changed_.wait_until(lock, due);
      } else {
        late_.begin()->second.send();
        late_.erase(late_.begin());
      }
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::mt19937_64 random_;
  std::multimap<Clock::time_point, Datagram> late_;
  std::atomic<std::uint64_t>* counts_ = nullptr;  // lost, doubled, delayed
  double lost_ = 0.0;
  double doubled_ = 0.0;
  double delayed_ = 0.0;
  bool started_ = false;
};

Network& network() {
  static auto* const kNetwork = new Network;  // its thread may outlive main()
  return *kNetwork;
}

bool is_multicast(const void* address, socklen_t size) {
  const auto* const to = static_cast<const sockaddr_in*>(address);
  return to != nullptr && size == sizeof *to && to->sin_family == AF_INET &&
         IN_MULTICAST(ntohl(to->sin_addr.s_addr));
}

}  // namespace

extern "C" ssize_t sendmsg(int fd, const msghdr* message, int flags) {
  static auto* const kSend = libc<SendMessage>("sendmsg");
  if (!is_multicast(message->msg_name, message->msg_namelen)) return kSend(fd, message, flags);
  Datagram datagram{fd, flags, {}, {}};
  std::memcpy(&datagram.to, message->msg_name, sizeof datagram.to);
  for (size_t i = 0; i < message->msg_iovlen; ++i) {
    const iovec& part = message->msg_iov[i];
    datagram.bytes.append(static_cast<const char*>(part.iov_base), part.iov_len);
  }
  const auto size = static_cast<ssize_t>(datagram.bytes.size());
  network().take(std::move(datagram));
  return size;
}

extern "C" ssize_t sendto(int fd, const void* bytes, size_t size, int flags,
                          const sockaddr* address, socklen_t address_size) {
  static auto* const kSend = libc<SendTo>("sendto");
  if (!is_multicast(address, address_size)) {
    return kSend(fd, bytes, size, flags, address, address_size);
  }
  Datagram datagram{fd, flags, {}, std::string(static_cast<const char*>(bytes), size)};
  std::memcpy(&datagram.to, address, sizeof datagram.to);
  network().take(std::move(datagram));
  return static_cast<ssize_t>(size);
}
